//! Convolutions of binary pictures, of which a few per cent are lit.
//!
//! Away from lit pixels every layer puts out what it does for the blank picture, which is computed once a step. So of each
//! picture only *spans* are computed: in every row one run of pixels, as far as a lit pixel reaches. The way back is linear
//! in the deltas, and what lies outside of the spans of some pictures is one blank picture with the sum of their deltas.
//! This is exact, not an approximation.

use super::{
    Conv, Kernels,
    kernels::{accumulate, correlate},
    lit::{Lit, Run},
    shares::{Shares, Slots, by_layer},
    spans::Spans,
};
use crate::{
    nn::{
        columns::{Block, BlockMut, Cut, MOST_THREADS},
        mat::Into,
        mlp::{Layout, sum_columns},
        pictures::Pictures,
    },
    num::{Real, simd::vectorize},
};

/// A convolution of stride 1 on observations, then `L` that take them down, with ReLU after each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LitStack<const L: usize> {
    lit: Lit,
    convs: [Conv; L],
}

/// What all pictures of a step share.
#[derive(Debug, Clone)]
pub struct LitReady<T> {
    kernels: Vec<Kernels<T>>,
    /// The first layer's weights, summed over runs of taps.
    lit: Vec<T>,
    /// The padded input of each layer for the blank picture, and what it puts out.
    inputs: Vec<Vec<T>>,
    outs: Vec<Vec<T>>,
    /// All pixels of what each layer puts out.
    whole: Vec<Spans>,
}

/// A thread's own copies of one picture.
#[derive(Debug, Clone)]
pub struct Slot<T> {
    lit: Vec<Run>,
    /// Of the input of each layer, and of what the last one puts out.
    spans: Vec<Spans>,
    /// The padded input of each layer: outside of its spans that of the blank picture.
    inputs: Vec<Vec<T>>,
    /// Padded deltas of each layer. Those outside of spans are left over from other pictures, and nobody reads them.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to what a layer put out, without borders and before ReLU; elsewhere as in `deltas`.
    d_out: Vec<T>,
    /// The same for the last layer, everywhere, and its sum over a share.
    d_top: Vec<T>,
    sum_top: Vec<T>,
    /// Sums over a share, within spans: of the padded deltas of each layer, and of the same before ReLU.
    sums: Vec<Vec<T>>,
    sums_before: Vec<Vec<T>>,
    /// The latter for the first layer, by channel.
    lit_before: Vec<T>,
    /// Room for the spans of a phase.
    runs: Vec<[usize; 2]>,
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
pub struct LitPass<T, const L: usize> {
    /// What each layer put out, within the spans of a picture; all of it for the last one.
    outs: [Block<T>; L],
    slots: Vec<Slot<T>>,
}

/// Some pictures of a [`LitPass`].
#[derive(Debug)]
pub struct LitMut<'a, T, const L: usize> {
    outs: [BlockMut<'a, T>; L],
    slots: Slots<'a, Slot<T>>,
}

impl<T: Real, const L: usize> LitPass<T, L> {
    /// Room for `samples` samples of `each` pictures.
    pub fn new(stack: &LitStack<L>, samples: usize, each: usize) -> Self {
        Self {
            outs: stack.convs.each_ref().map(|conv| Block::new(conv.width() * each, samples)),
            slots: (0..MOST_THREADS).map(|_| Slot::new(stack)).collect(),
        }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> LitMut<'_, T, L> {
        LitMut { outs: self.outs.each_mut().map(|out| out.view(samples)), slots: Slots(&mut self.slots) }
    }
}

impl<T: Real, const L: usize> Cut for LitMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (outs, outs_right) = self.outs.cut(samples);
        let (slots, slots_right) = self.slots.cut(samples);
        (Self { outs, slots }, Self { outs: outs_right, slots: slots_right })
    }
}

impl<T: Real> Slot<T> {
    fn new<const L: usize>(stack: &LitStack<L>) -> Self {
        let convs = &stack.convs;
        let each = |len: fn(&Conv) -> usize| convs.iter().map(|conv| vec![T::nil(); len(conv)]).collect();
        let largest = convs.iter().map(Conv::input_len).max().unwrap_or(0);
        let rows = convs.iter().map(|conv| conv.input[0]).chain(convs.last().map(|conv| conv.core[0]));
        Self {
            // At most every other pixel begins a run.
            lit: Vec::with_capacity(stack.lit.pixels().div_ceil(2)),
            spans: rows.map(Spans::new).collect(),
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_out: vec![T::nil(); largest],
            d_top: vec![T::nil(); stack.top().width()],
            sum_top: vec![T::nil(); stack.top().width()],
            sums: each(Conv::delta_padded_len),
            sums_before: each(Conv::width),
            lit_before: vec![T::nil(); stack.lit.weights.n_out],
            runs: Vec::with_capacity(convs.first().map_or(0, |conv| conv.input[0])),
        }
    }

    /// Shows the blank picture.
    fn clear(&mut self, ready: &LitReady<T>) {
        for (input, blank) in self.inputs.iter_mut().zip(&ready.inputs) {
            input.copy_from_slice(blank);
        }
    }

    /// Shows the blank picture and forgets the sums.
    fn begin_share(&mut self, ready: &LitReady<T>) {
        self.clear(ready);
        let sums = self.sums.iter_mut().chain(&mut self.sums_before);
        sums.chain([&mut self.sum_top, &mut self.lit_before]).for_each(|sums| sums.fill(T::nil()));
    }

    /// Takes in a picture's gradient with respect to what the last layer put out.
    fn take_top(&mut self, top: &Conv, d_flat: &[T]) {
        top.unflatten(d_flat, &mut self.d_top);
        self.sum_top.iter_mut().zip(&self.d_top).for_each(|(sum, &d)| *sum += d);
        self.d_out[..self.d_top.len()].copy_from_slice(&self.d_top);
    }

    /// Shows the blank picture again after another one.
    fn restore<const L: usize>(&mut self, convs: &[Conv; L], ready: &LitReady<T>) {
        for (((conv, spans), input), blank) in convs.iter().zip(&self.spans).zip(&mut self.inputs).zip(&ready.inputs) {
            for (row, run) in spans.iter() {
                let at = conv.input_at(row, run.start);
                let end = at + run.len() * conv.forward.c_in;
                input[at..end].copy_from_slice(&blank[at..end]);
            }
        }
    }

    /// Writes what a layer put out within its spans into the padded input of the next.
    fn pass_on<const L: usize>(&mut self, convs: &[Conv; L], l: usize, out: &[T]) {
        let Some(next) = convs.get(l + 1) else { return };
        for (row, run) in self.spans[l + 1].iter() {
            let (at, len) = (convs[l].output_at(row, run.start), run.len() * next.forward.c_in);
            self.inputs[l + 1][next.input_at(row, run.start)..][..len].copy_from_slice(&out[at..at + len]);
        }
    }

    /// Within spans of what layer `l` put out, those of the picture unless others are given: `d_out` through ReLU into the
    /// deltas, and both into the sums.
    fn rectify_deltas(&mut self, conv: &Conv, l: usize, spans: Option<&Spans>, out: &[T]) {
        let (deltas, sums, before) = (&mut self.deltas[l], &mut self.sums[l], &mut self.sums_before[l]);
        vectorize(
            #[inline(always)]
            || {
                for (row, run) in spans.unwrap_or(&self.spans[l + 1]).iter() {
                    let (at, len) = (conv.output_at(row, run.start), run.len() * conv.forward.c_out);
                    let padded = conv.delta_at(row, run.start);
                    let (out, d_out) = (&out[at..at + len], &self.d_out[at..at + len]);
                    let (deltas, sums) = (&mut deltas[padded..padded + len], &mut sums[padded..padded + len]);
                    let before = &mut before[at..at + len];
                    for i in 0..len {
                        let delta = if out[i] > T::nil() { d_out[i] } else { T::nil() };
                        deltas[i] = delta;
                        sums[i] += delta;
                        before[i] += d_out[i];
                    }
                }
            },
        );
    }
}

impl<const L: usize> LitStack<L> {
    /// A first layer on `frames` frames of `size`, whose parameters come first, and what follows.
    pub fn new(
        layout: &mut Layout,
        name: &str,
        (frames, size): (usize, [usize; 2]),
        channels: usize,
        convs: impl FnOnce(&mut Layout) -> [Conv; L],
    ) -> Self {
        let lit = Lit::new(layout, &format!("{name}.0"), frames, size, channels);
        Self { lit, convs: convs(layout) }
    }

    /// Room for what all pictures of a step share.
    pub fn ready<T: Real>(&self) -> LitReady<T> {
        LitReady {
            kernels: self.convs.iter().map(Kernels::new).collect(),
            lit: vec![T::nil(); self.lit.run_weights()],
            inputs: self.convs.iter().map(|conv| vec![T::nil(); conv.padded_len()]).collect(),
            outs: self.convs.iter().map(|conv| vec![T::nil(); conv.width()]).collect(),
            whole: self.convs.iter().map(|conv| Spans::whole(conv.core)).collect(),
        }
    }

    fn top(&self) -> &Conv {
        &self.convs[L - 1]
    }

    /// Fills it in; once a step.
    pub fn prepare<T: Real>(&self, arena: &[T], ready: &mut LitReady<T>) {
        vectorize(
            #[inline(always)]
            || self.convs.iter().zip(&mut ready.kernels).for_each(|(conv, kernels)| conv.prepare(arena, kernels)),
        );
        self.lit.prepare(arena, &mut ready.lit);
        self.lit.blank(arena, &self.convs[0], &mut ready.inputs[0]);
        for (l, (conv, kernels)) in self.convs.iter().zip(&ready.kernels).enumerate() {
            let out = &mut ready.outs[l];
            correlate(&conv.forward, None, &kernels.forward, &kernels.bias, conv.relu, &ready.inputs[l], out);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(out, next, &mut ready.inputs[l + 1]);
            }
        }
    }

    /// Shows a picture: its spans, and what the first layer puts out there.
    fn show<T: Real>(
        &self,
        (arena, ready): (&[T], &LitReady<T>),
        (pictures, picture): (&Pictures, u32),
        slot: &mut Slot<T>,
    ) {
        self.lit.runs(pictures, picture, &mut slot.lit);
        let (first, others) = slot.spans.split_at_mut(1);
        self.lit.spans(&slot.lit, &mut first[0]);
        let mut before = &first[0];
        for (conv, spans) in self.convs.iter().zip(others) {
            spans.after(conv, before);
            before = spans;
        }
        self.lit.forward((arena, &ready.lit), (&slot.lit, &slot.spans[0]), &self.convs[0], &mut slot.inputs[0]);
    }

    /// What the last layer puts out for the pictures `which`, pixel by pixel, into `flat`.
    pub fn forward<T: Real>(
        &self,
        arena: &[T],
        ready: &LitReady<T>,
        (pictures, which): (&Pictures, &[u32]),
        pass: &mut LitMut<'_, T, L>,
        flat: &mut [T],
    ) {
        let slot = &mut pass.slots.0[0];
        slot.clear(ready);
        for ((i, &picture), flat) in which.iter().enumerate().zip(flat.chunks_exact_mut(self.top().pixels())) {
            self.show((arena, ready), (pictures, picture), slot);
            for (l, (conv, kernels)) in self.convs.iter().zip(&ready.kernels).enumerate() {
                let out = &mut pass.outs[l].data[i * conv.width()..][..conv.width()];
                if l + 1 == L {
                    out.copy_from_slice(&ready.outs[l]);
                }
                let runs = Some(slot.spans[l + 1].runs());
                let input = &slot.inputs[l];
                correlate(&conv.forward, runs, &kernels.forward, &kernels.bias, conv.relu, input, out);
                slot.pass_on(&self.convs, l, out);
            }
            self.top().flatten(&pass.outs[L - 1].data[i * self.top().width()..], flat);
            slot.restore(&self.convs, ready);
        }
    }

    /// Room for the sums over shares of the batch.
    pub fn shares<T: Real>(&self) -> Shares<T> {
        Shares::new(&self.convs, self.lit.run_weights() + self.lit.weights.n_out)
    }

    /// Sets the gradients of all weights from those with respect to what [`LitStack::forward`] gave, of which those are
    /// zero where that was.
    #[allow(clippy::too_many_arguments, reason = "a way back names what went forth and where its gradients go")]
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        (arena, ready): (&[T], &LitReady<T>),
        gradient: &mut [T],
        (pictures, which): (&Pictures, &[u32]),
        pass: &mut LitPass<T, L>,
        d_flat: &[T],
        shares: &mut Shares<T>,
    ) {
        let outs = &pass.outs;
        shares.sum(threads, which.len(), &mut pass.slots, &|pictures_of_share, sums, slot| {
            slot.begin_share(ready);
            let (mut sums, lit_sums) = by_layer(&self.convs, sums);
            for i in pictures_of_share {
                let out = |l: usize| &outs[l].data[i * self.convs[l].width()..][..self.convs[l].width()];
                self.show((arena, ready), (pictures, which[i]), slot);
                (0..L - 1).for_each(|l| slot.pass_on(&self.convs, l, out(l)));
                slot.take_top(self.top(), &d_flat[i * self.top().pixels()..]);
                for (l, conv) in self.convs.iter().enumerate().rev() {
                    slot.rectify_deltas(conv, l, None, out(l));
                    let (runs, deltas) = (Some(slot.spans[l + 1].runs()), conv.deltas(&slot.deltas[l]));
                    accumulate(&conv.forward, runs, &slot.inputs[l], deltas, sums[l][0]);
                    let within = Some((&slot.spans[l], &mut slot.runs));
                    conv.d_input(&ready.kernels[l], &slot.deltas[l], within, &mut slot.d_out);
                }
                let Slot { lit, spans, inputs, d_out, lit_before, .. } = &mut *slot;
                self.lit.gradient((lit, &spans[0]), &self.convs[0], &inputs[0], d_out, lit_sums, lit_before);
                slot.restore(&self.convs, ready);
            }
            self.blank_gradient(arena, ready, slot, &mut sums, lit_sums);
        });
        let sums = shares.unfold(&self.convs, gradient);
        self.lit.unfold(sums, gradient);
    }

    /// What lies outside of spans: gradients for the blank picture, and the sums of all deltas.
    fn blank_gradient<T: Real>(
        &self,
        arena: &[T],
        ready: &LitReady<T>,
        slot: &mut Slot<T>,
        sums: &mut [[&mut [T]; 2]; L],
        lit_sums: &mut [T],
    ) {
        slot.d_out[..slot.sum_top.len()].copy_from_slice(&slot.sum_top);
        for (l, conv) in self.convs.iter().enumerate().rev() {
            // What went back through all pictures, less what was within their spans.
            for (d_out, &within) in slot.d_out.iter_mut().zip(&slot.sums_before[l]) {
                *d_out -= within;
            }
            slot.rectify_deltas(conv, l, Some(&ready.whole[l]), &ready.outs[l]);
            let [dw, db] = &mut sums[l];
            accumulate(&conv.forward, None, &ready.inputs[l], conv.deltas(&slot.deltas[l]), dw);
            let row = conv.core[1] * conv.forward.c_out;
            for r in 0..conv.core[0] {
                sum_columns(db, Into::Add, &slot.sums[l][conv.delta_at(r, 0)..][..row]);
            }
            conv.d_input(&ready.kernels[l], &slot.sums[l], None, &mut slot.d_out);
        }
        self.lit.blank_gradient(arena, &slot.d_out, &mut slot.lit_before, lit_sums);
    }
}
