//! Convolutions of binary images, of which a few per cent are lit.
//!
//! Away from lit pixels every layer puts out what it does for the blank image, which is computed once a step. So of each
//! image only *active_rows* are computed: in every row one run of pixels, as far as a lit pixel reaches. The way back is linear
//! in the deltas, and what lies outside of the active_rows of some images is one blank image with the sum of their deltas.
//! This is exact, not an approximation.

use super::{
    Conv, PackedWeights,
    active_rows::ActiveRows,
    kernels::{accumulate, correlate},
    shard_sums::{PerThread, ShardSums, by_layer},
    sparse::{Run, SparseConv},
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, Cut, MAX_THREADS},
        mat::Accumulate,
        mlp::{Layout, sum_columns},
    },
    num::{Real, simd::vectorize},
};

/// A convolution of stride 1 on observations, then `L` that take them down, with ReLU after each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparseConvStack<const L: usize> {
    lit: SparseConv,
    convs: [Conv; L],
}

/// What all images of a step share.
#[derive(Debug, Clone)]
pub struct SparseConvWeights<T> {
    kernels: Vec<PackedWeights<T>>,
    /// The first layer's weights, summed over runs of taps.
    lit: Vec<T>,
    /// The padded input of each layer for the blank image, and what it puts out.
    inputs: Vec<Vec<T>>,
    outs: Vec<Vec<T>>,
    /// All pixels of what each layer puts out.
    whole: Vec<ActiveRows>,
}

/// A thread's own copies of one image.
#[derive(Debug, Clone)]
pub struct ThreadBuffers<T> {
    lit: Vec<Run>,
    /// Of the input of each layer, and of what the last one puts out.
    active_rows: Vec<ActiveRows>,
    /// The padded input of each layer: outside of its active_rows that of the blank image.
    inputs: Vec<Vec<T>>,
    /// Padded deltas of each layer. Those outside of active_rows are left over from other images, and nobody reads them.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to what a layer put out, without borders and before ReLU; elsewhere as in `deltas`.
    d_out: Vec<T>,
    /// The same for the last layer, everywhere, and its sum over a share.
    d_top: Vec<T>,
    sum_top: Vec<T>,
    /// Sums over a share, within active_rows: of the padded deltas of each layer, and of the same before ReLU.
    sums: Vec<Vec<T>>,
    sums_before: Vec<Vec<T>>,
    /// The latter for the first layer, by channel.
    lit_before: Vec<T>,
    /// Room for the active_rows of a phase.
    runs: Vec<[usize; 2]>,
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
pub struct SparseConvPass<T, const L: usize> {
    /// What each layer put out, within the active_rows of an image; all of it for the last one.
    outs: [Block<T>; L],
    per_thread: Vec<ThreadBuffers<T>>,
}

/// Some images of a [`SparseConvPass`].
#[derive(Debug)]
pub struct SparseConvMut<'a, T, const L: usize> {
    outs: [BlockMut<'a, T>; L],
    per_thread: PerThread<'a, ThreadBuffers<T>>,
}

impl<T: Real, const L: usize> SparseConvPass<T, L> {
    /// Room for `samples` samples of `each` images.
    pub fn new(stack: &SparseConvStack<L>, samples: usize, each: usize) -> Self {
        Self {
            outs: stack.convs.each_ref().map(|conv| Block::new(conv.width() * each, samples)),
            per_thread: (0..MAX_THREADS).map(|_| ThreadBuffers::new(stack)).collect(),
        }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> SparseConvMut<'_, T, L> {
        SparseConvMut {
            outs: self.outs.each_mut().map(|out| out.view(samples)),
            per_thread: PerThread(&mut self.per_thread),
        }
    }
}

impl<T: Real, const L: usize> Cut for SparseConvMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (outs, outs_right) = self.outs.cut(samples);
        let (per_thread, per_thread_right) = self.per_thread.cut(samples);
        (Self { outs, per_thread }, Self { outs: outs_right, per_thread: per_thread_right })
    }
}

impl<T: Real> ThreadBuffers<T> {
    fn new<const L: usize>(stack: &SparseConvStack<L>) -> Self {
        let convs = &stack.convs;
        let each = |len: fn(&Conv) -> usize| convs.iter().map(|conv| vec![T::ZERO; len(conv)]).collect();
        let largest = convs.iter().map(Conv::input_len).max().unwrap_or(0);
        let rows = convs.iter().map(|conv| conv.input[0]).chain(convs.last().map(|conv| conv.core[0]));
        Self {
            // At most every other pixel begins a run.
            lit: Vec::with_capacity(stack.lit.pixels().div_ceil(2)),
            active_rows: rows.map(ActiveRows::new).collect(),
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_out: vec![T::ZERO; largest],
            d_top: vec![T::ZERO; stack.top().width()],
            sum_top: vec![T::ZERO; stack.top().width()],
            sums: each(Conv::delta_padded_len),
            sums_before: each(Conv::width),
            lit_before: vec![T::ZERO; stack.lit.weights.n_out],
            runs: Vec::with_capacity(convs.first().map_or(0, |conv| conv.input[0])),
        }
    }

    /// Shows the blank image.
    fn clear(&mut self, ready: &SparseConvWeights<T>) {
        for (input, blank) in self.inputs.iter_mut().zip(&ready.inputs) {
            input.copy_from_slice(blank);
        }
    }

    /// Shows the blank image and forgets the sums.
    fn begin_share(&mut self, ready: &SparseConvWeights<T>) {
        self.clear(ready);
        let sums = self.sums.iter_mut().chain(&mut self.sums_before);
        sums.chain([&mut self.sum_top, &mut self.lit_before]).for_each(|sums| sums.fill(T::ZERO));
    }

    /// Takes in an image's gradient with respect to what the last layer put out.
    fn take_top(&mut self, top: &Conv, d_flat: &[T]) {
        top.unflatten(d_flat, &mut self.d_top);
        self.sum_top.iter_mut().zip(&self.d_top).for_each(|(sum, &d)| *sum += d);
        self.d_out[..self.d_top.len()].copy_from_slice(&self.d_top);
    }

    /// Shows the blank image again after another one.
    fn restore<const L: usize>(&mut self, convs: &[Conv; L], ready: &SparseConvWeights<T>) {
        for (((conv, active_rows), input), blank) in
            convs.iter().zip(&self.active_rows).zip(&mut self.inputs).zip(&ready.inputs)
        {
            for (row, run) in active_rows.iter() {
                let at = conv.input_at(row, run.start);
                let end = at + run.len() * conv.forward.c_in;
                input[at..end].copy_from_slice(&blank[at..end]);
            }
        }
    }

    /// Writes what a layer put out within its active_rows into the padded input of the next.
    fn pass_on<const L: usize>(&mut self, convs: &[Conv; L], l: usize, out: &[T]) {
        let Some(next) = convs.get(l + 1) else { return };
        for (row, run) in self.active_rows[l + 1].iter() {
            let (at, len) = (convs[l].output_at(row, run.start), run.len() * next.forward.c_in);
            self.inputs[l + 1][next.input_at(row, run.start)..][..len].copy_from_slice(&out[at..at + len]);
        }
    }

    /// Within active_rows of what layer `l` put out, those of the image unless others are given: `d_out` through ReLU into the
    /// deltas, and both into the sums.
    fn rectify_deltas(&mut self, conv: &Conv, l: usize, active_rows: Option<&ActiveRows>, out: &[T]) {
        let (deltas, sums, before) = (&mut self.deltas[l], &mut self.sums[l], &mut self.sums_before[l]);
        vectorize(
            #[inline(always)]
            || {
                for (row, run) in active_rows.unwrap_or(&self.active_rows[l + 1]).iter() {
                    let (at, len) = (conv.output_at(row, run.start), run.len() * conv.forward.c_out);
                    let padded = conv.delta_at(row, run.start);
                    let (out, d_out) = (&out[at..at + len], &self.d_out[at..at + len]);
                    let (deltas, sums) = (&mut deltas[padded..padded + len], &mut sums[padded..padded + len]);
                    let before = &mut before[at..at + len];
                    for i in 0..len {
                        let delta = if out[i] > T::ZERO { d_out[i] } else { T::ZERO };
                        deltas[i] = delta;
                        sums[i] += delta;
                        before[i] += d_out[i];
                    }
                }
            },
        );
    }
}

impl<const L: usize> SparseConvStack<L> {
    /// A first layer on `frames` frames of `size`, whose parameters come first, and what follows.
    pub fn new(
        layout: &mut Layout,
        name: &str,
        (frames, size): (usize, [usize; 2]),
        channels: usize,
        convs: impl FnOnce(&mut Layout) -> [Conv; L],
    ) -> Self {
        let lit = SparseConv::new(layout, &format!("{name}.0"), frames, size, channels);
        Self { lit, convs: convs(layout) }
    }

    /// Room for what all images of a step share.
    pub fn packed_weights<T: Real>(&self) -> SparseConvWeights<T> {
        SparseConvWeights {
            kernels: self.convs.iter().map(PackedWeights::new).collect(),
            lit: vec![T::ZERO; self.lit.run_weights()],
            inputs: self.convs.iter().map(|conv| vec![T::ZERO; conv.padded_len()]).collect(),
            outs: self.convs.iter().map(|conv| vec![T::ZERO; conv.width()]).collect(),
            whole: self.convs.iter().map(|conv| ActiveRows::whole(conv.core)).collect(),
        }
    }

    fn top(&self) -> &Conv {
        &self.convs[L - 1]
    }

    /// Fills it in; once a step.
    pub fn pack<T: Real>(&self, arena: &[T], ready: &mut SparseConvWeights<T>) {
        vectorize(
            #[inline(always)]
            || self.convs.iter().zip(&mut ready.kernels).for_each(|(conv, kernels)| conv.pack(arena, kernels)),
        );
        self.lit.pack(arena, &mut ready.lit);
        self.lit.blank(arena, &self.convs[0], &mut ready.inputs[0]);
        for (l, (conv, kernels)) in self.convs.iter().zip(&ready.kernels).enumerate() {
            let out = &mut ready.outs[l];
            correlate(&conv.forward, None, &kernels.forward, &kernels.bias, conv.relu, &ready.inputs[l], out);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(out, next, &mut ready.inputs[l + 1]);
            }
        }
    }

    /// Shows an image: its active_rows, and what the first layer puts out there.
    fn show<T: Real>(
        &self,
        (arena, ready): (&[T], &SparseConvWeights<T>),
        (images, image): (&BinaryImages, u32),
        buffers: &mut ThreadBuffers<T>,
    ) {
        self.lit.runs(images, image, &mut buffers.lit);
        let (first, others) = buffers.active_rows.split_at_mut(1);
        self.lit.active_rows(&buffers.lit, &mut first[0]);
        let mut before = &first[0];
        for (conv, active_rows) in self.convs.iter().zip(others) {
            active_rows.after(conv, before);
            before = active_rows;
        }
        self.lit.forward(
            (arena, &ready.lit),
            (&buffers.lit, &buffers.active_rows[0]),
            &self.convs[0],
            &mut buffers.inputs[0],
        );
    }

    /// What the last layer puts out for the images `which`, pixel by pixel, into `flat`.
    pub fn forward<T: Real>(
        &self,
        arena: &[T],
        ready: &SparseConvWeights<T>,
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut SparseConvMut<'_, T, L>,
        flat: &mut [T],
    ) {
        let buffers = &mut pass.per_thread.0[0];
        buffers.clear(ready);
        for ((i, &image), flat) in which.iter().enumerate().zip(flat.chunks_exact_mut(self.top().pixels())) {
            self.show((arena, ready), (images, image), buffers);
            for (l, (conv, kernels)) in self.convs.iter().zip(&ready.kernels).enumerate() {
                let out = &mut pass.outs[l].data[i * conv.width()..][..conv.width()];
                if l + 1 == L {
                    out.copy_from_slice(&ready.outs[l]);
                }
                let runs = Some(buffers.active_rows[l + 1].runs());
                let input = &buffers.inputs[l];
                correlate(&conv.forward, runs, &kernels.forward, &kernels.bias, conv.relu, input, out);
                buffers.pass_on(&self.convs, l, out);
            }
            self.top().flatten(&pass.outs[L - 1].data[i * self.top().width()..], flat);
            buffers.restore(&self.convs, ready);
        }
    }

    /// Room for the sums over shares of the batch.
    pub fn shard_sums<T: Real>(&self) -> ShardSums<T> {
        ShardSums::new(&self.convs, self.lit.run_weights() + self.lit.weights.n_out)
    }

    /// Sets the gradients of all weights from those with respect to what [`SparseConvStack::forward`] gave, of which those are
    /// zero where that was.
    #[allow(clippy::too_many_arguments, reason = "a way back names what went forth and where its gradients go")]
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        (arena, ready): (&[T], &SparseConvWeights<T>),
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut SparseConvPass<T, L>,
        d_flat: &[T],
        shares: &mut ShardSums<T>,
    ) {
        let outs = &pass.outs;
        shares.sum(threads, which.len(), &mut pass.per_thread, &|images_of_shard, sums, buffers| {
            buffers.begin_share(ready);
            let (mut sums, lit_sums) = by_layer(&self.convs, sums);
            for i in images_of_shard {
                let out = |l: usize| &outs[l].data[i * self.convs[l].width()..][..self.convs[l].width()];
                self.show((arena, ready), (images, which[i]), buffers);
                (0..L - 1).for_each(|l| buffers.pass_on(&self.convs, l, out(l)));
                buffers.take_top(self.top(), &d_flat[i * self.top().pixels()..]);
                for (l, conv) in self.convs.iter().enumerate().rev() {
                    buffers.rectify_deltas(conv, l, None, out(l));
                    let (runs, deltas) = (Some(buffers.active_rows[l + 1].runs()), conv.deltas(&buffers.deltas[l]));
                    accumulate(&conv.forward, runs, &buffers.inputs[l], deltas, sums[l][0]);
                    let within = Some((&buffers.active_rows[l], &mut buffers.runs));
                    conv.d_input(&ready.kernels[l], &buffers.deltas[l], within, &mut buffers.d_out);
                }
                let ThreadBuffers { lit, active_rows, inputs, d_out, lit_before, .. } = &mut *buffers;
                self.lit.gradient((lit, &active_rows[0]), &self.convs[0], &inputs[0], d_out, lit_sums, lit_before);
                buffers.restore(&self.convs, ready);
            }
            self.blank_gradient(arena, ready, buffers, &mut sums, lit_sums);
        });
        let sums = shares.unfold(&self.convs, gradient);
        self.lit.unfold(sums, gradient);
    }

    /// What lies outside of active_rows: gradients for the blank image, and the sums of all deltas.
    fn blank_gradient<T: Real>(
        &self,
        arena: &[T],
        ready: &SparseConvWeights<T>,
        buffers: &mut ThreadBuffers<T>,
        sums: &mut [[&mut [T]; 2]; L],
        lit_sums: &mut [T],
    ) {
        buffers.d_out[..buffers.sum_top.len()].copy_from_slice(&buffers.sum_top);
        for (l, conv) in self.convs.iter().enumerate().rev() {
            // What went back through all images, less what was within their active_rows.
            for (d_out, &within) in buffers.d_out.iter_mut().zip(&buffers.sums_before[l]) {
                *d_out -= within;
            }
            buffers.rectify_deltas(conv, l, Some(&ready.whole[l]), &ready.outs[l]);
            let [dw, db] = &mut sums[l];
            accumulate(&conv.forward, None, &ready.inputs[l], conv.deltas(&buffers.deltas[l]), dw);
            let row = conv.core[1] * conv.forward.c_out;
            for r in 0..conv.core[0] {
                sum_columns(db, Accumulate::Add, &buffers.sums[l][conv.delta_at(r, 0)..][..row]);
            }
            conv.d_input(&ready.kernels[l], &buffers.sums[l], None, &mut buffers.d_out);
        }
        self.lit.blank_gradient(arena, &buffers.d_out, &mut buffers.lit_before, lit_sums);
    }
}
