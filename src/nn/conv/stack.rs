//! Convolutions one after the other, picture by picture.
//!
//! What every layer puts out and its gradient are kept for the whole batch; padded copies live in a thread's scratch.

use super::{
    Conv, Kernels,
    kernels::{accumulate, correlate},
};
use crate::nn::{
    Real,
    columns::{Block, BlockMut, Cut, MOST_THREADS, over_samples},
    mlp::{Pass, PassMut},
    vectorize,
};

/// Gradients of weights are summed over so many equal shares of the batch, in order, and then over the shares: no sum
/// depends on how many threads there were.
const SHARES: usize = 8;

/// `L` layers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stack<const L: usize> {
    /// Its layers.
    pub convs: [Conv; L],
}

/// A thread's own copies of pictures with their borders of zeros, which nothing ever writes.
#[derive(Debug, Clone)]
pub struct Slot<T> {
    /// The input of each layer.
    pub(super) inputs: Vec<Vec<T>>,
    /// The deltas of each layer.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to one layer's input, without borders.
    pub(super) d_input: Vec<T>,
    zeros: Vec<T>,
}

/// A slot for every thread.
#[derive(Debug, Clone)]
pub struct Scratch<T>(Vec<Slot<T>>);

impl<T: Real> Scratch<T> {
    fn new<const L: usize>(stack: &Stack<L>) -> Self {
        let each = |len: fn(&Conv) -> usize| stack.convs.iter().map(|conv| vec![T::nil(); len(conv)]).collect();
        let most = |len: fn(&Conv) -> usize| vec![T::nil(); stack.convs.iter().map(len).max().unwrap_or(0)];
        let slot = || Slot {
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_input: most(Conv::input_len),
            zeros: most(|conv| conv.forward.c_in),
        };
        Self((0..MOST_THREADS).map(|_| slot()).collect())
    }
}

/// The slots of some threads.
#[derive(Debug)]
pub struct ScratchMut<'a, T>(&'a mut [Slot<T>]);

impl<T> Cut for ScratchMut<'_, T> {
    fn cut(self, _: usize) -> (Self, Self) {
        let (left, right) = self.0.split_at_mut(self.0.len() / 2);
        (Self(left), Self(right))
    }
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
pub struct StackPass<T, const L: usize> {
    layers: Pass<T, L>,
    scratch: Scratch<T>,
}

/// Some pictures of a [`StackPass`].
#[derive(Debug)]
pub struct StackMut<'a, T, const L: usize> {
    /// What each core put out, and its deltas.
    pub layers: PassMut<'a, T, L>,
    scratch: ScratchMut<'a, T>,
}

impl<T: Real, const L: usize> StackPass<T, L> {
    /// Room for `samples` samples of `each` pictures.
    pub fn new(stack: &Stack<L>, samples: usize, each: usize) -> Self {
        let widths = stack.convs.each_ref().map(|conv| conv.width() * each);
        Self { layers: Pass::of_widths(widths, samples), scratch: Scratch::new(stack) }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> StackMut<'_, T, L> {
        StackMut { layers: self.layers.view(samples), scratch: ScratchMut(&mut self.scratch.0) }
    }
}

impl<T: Real, const L: usize> Cut for StackMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (left, right) = self.layers.split_at(samples);
        let (scratch, scratch_right) = self.scratch.cut(samples);
        (Self { layers: left, scratch }, Self { layers: right, scratch: scratch_right })
    }
}

/// Goes on from the gradient with respect to a picture's input, which it may change: gets the picture's number, the padded
/// input, that gradient without borders, and the caller's own sums.
pub type Rest<'a, T> = &'a (dyn Fn(usize, &[T], &mut [T], &mut [T]) + Sync);

/// One picture's part of a buffer.
fn of<T>(buffer: &[T], width: usize, picture: usize) -> &[T] {
    &buffer[picture * width..][..width]
}

fn of_mut<T>(buffer: &mut [T], width: usize, picture: usize) -> &mut [T] {
    &mut buffer[picture * width..][..width]
}

impl<const L: usize> Stack<L> {
    /// Room for the weights as the loops read them.
    pub fn kernels<T: Real>(&self) -> Vec<Kernels<T>> {
        self.convs.iter().map(Kernels::new).collect()
    }

    /// Fills them in; once a step.
    pub fn prepare<T: Real>(&self, arena: &[T], kernels: &mut [Kernels<T>]) {
        vectorize(
            #[inline(always)]
            || {
                for (conv, kernels) in self.convs.iter().zip(kernels) {
                    conv.prepare(arena, kernels);
                }
            },
        );
    }

    /// All layers on every picture; `fill` writes a picture into the padded input of the first.
    pub fn forward<T: Real>(
        &self,
        kernels: &[Kernels<T>],
        pass: &mut StackMut<'_, T, L>,
        fill: impl Fn(usize, &mut [T]),
    ) {
        let slot = &mut pass.scratch.0[0];
        for picture in 0..pass.layers.out[0].len() / self.convs[0].width() {
            fill(picture, &mut slot.inputs[0]);
            for (l, conv) in self.convs.iter().enumerate() {
                let out = of_mut(pass.layers.out[l], conv.width(), picture);
                correlate(&conv.forward, &kernels[l].forward, &kernels[l].bias, conv.relu, &slot.inputs[l], out);
                if let Some(next) = self.convs.get(l + 1) {
                    conv.spread(out, next, &mut slot.inputs[l + 1]);
                }
            }
        }
    }

    /// Deltas of all layers from those of the last; then, where asked, `take` gets the gradient with respect to each
    /// picture, without borders.
    pub fn backward<T: Real>(
        &self,
        kernels: &[Kernels<T>],
        pass: &mut StackMut<'_, T, L>,
        mut take: Option<impl FnMut(usize, &[T])>,
    ) {
        let slot = &mut pass.scratch.0[0];
        for picture in 0..pass.layers.out[0].len() / self.convs[0].width() {
            for l in (0..L).rev() {
                let conv = &self.convs[l];
                if l > 0 {
                    conv.d_input(&kernels[l], of(pass.layers.delta[l], conv.width(), picture), l, slot);
                    let before = &self.convs[l - 1];
                    let out = of(pass.layers.out[l - 1], before.width(), picture);
                    let delta = of_mut(pass.layers.delta[l - 1], before.width(), picture);
                    before.gather(&slot.d_input, self.convs[l].forward.c_in, out, delta);
                } else if let Some(take) = &mut take {
                    conv.d_input(&kernels[0], of(pass.layers.delta[0], conv.width(), picture), 0, slot);
                    take(picture, &slot.d_input[..conv.input_len()]);
                }
            }
        }
    }

    /// Numbers in a share's sums: for each layer those of the core's weights, then those of its biases; `more` at the
    /// end are the caller's.
    fn share_len(&self) -> usize {
        self.convs.iter().map(|conv| conv.forward.weights() + conv.forward.c_out).sum()
    }

    /// Room for the sums over shares of the batch.
    pub fn shares<T: Real>(&self, more: usize) -> Shares<T> {
        Shares { more, sums: Block::new(self.share_len() + more, SHARES) }
    }

    /// Gradients of all weights over `pictures` pictures. `fill` as in [`Stack::forward`]; `rest` gets the gradient with
    /// respect to a picture's input, beside that input, and adds to the caller's own sums. Gives those sums.
    #[allow(clippy::too_many_arguments, reason = "two closures beside what every pass takes")]
    pub fn gradient<'s, T: Real>(
        &self,
        threads: usize,
        kernels: &[Kernels<T>],
        pass: &mut StackMut<'_, T, L>,
        shares: &'s mut Shares<T>,
        gradient: &mut [T],
        fill: &(impl Fn(usize, &mut [T]) + Sync),
        rest: Option<Rest<'_, T>>,
    ) -> &'s [T] {
        let pictures = pass.layers.out[0].len() / self.convs[0].width();
        let (len, width) = (self.share_len(), self.share_len() + shares.more);
        shares.sums.data.fill(T::nil());
        let layers = &pass.layers;
        let columns = ShareMut { sums: shares.sums.view(SHARES), scratch: ScratchMut(&mut *pass.scratch.0) };
        over_samples(threads, 0, SHARES, columns, &|first, count, mut c| {
            let slot = &mut c.scratch.0[0];
            for share in 0..count {
                let (sums, more) = c.sums.of(share).split_at_mut(len);
                let [low, high] = [first + share, first + share + 1].map(|share| pictures * share / SHARES);
                for picture in low..high {
                    fill(picture, &mut slot.inputs[0]);
                    self.picture_gradient(picture, layers, slot, sums);
                    if let Some(rest) = rest {
                        let conv = &self.convs[0];
                        conv.d_input(&kernels[0], of(layers.delta[0], conv.width(), picture), 0, slot);
                        rest(picture, &slot.inputs[0], &mut slot.d_input[..conv.input_len()], more);
                    }
                }
            }
        });
        let (total, others) = shares.sums.data.split_at_mut(width);
        vectorize(
            #[inline(always)]
            || {
                for share in others.chunks_exact(width) {
                    for (total, &sum) in total.iter_mut().zip(share) {
                        *total += sum;
                    }
                }
            },
        );
        let mut sums = &*total;
        for conv in &self.convs {
            let (dw, after) = sums.split_at(conv.forward.weights());
            let (db, after) = after.split_at(conv.forward.c_out);
            conv.unfold(dw, db, gradient);
            sums = after;
        }
        sums
    }

    fn picture_gradient<T: Real>(
        &self,
        picture: usize,
        layers: &PassMut<'_, T, L>,
        slot: &mut Slot<T>,
        mut sums: &mut [T],
    ) {
        for (l, conv) in self.convs.iter().enumerate() {
            let delta = of(layers.delta[l], conv.width(), picture);
            let (dw, after) = sums.split_at_mut(conv.forward.weights());
            let (db, after) = after.split_at_mut(conv.forward.c_out);
            accumulate(&conv.forward, &slot.inputs[l], delta, dw);
            crate::nn::mlp::sum_columns(db, crate::nn::mat::Into::Add, delta);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(of(layers.out[l], conv.width(), picture), next, &mut slot.inputs[l + 1]);
            }
            sums = after;
        }
    }
}

/// Sums over shares of a batch.
#[derive(Debug, Clone)]
pub struct Shares<T> {
    more: usize,
    sums: Block<T>,
}

struct ShareMut<'a, T> {
    sums: BlockMut<'a, T>,
    scratch: ScratchMut<'a, T>,
}

impl<T> Cut for ShareMut<'_, T> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (sums, right) = self.sums.cut(samples);
        let (scratch, scratch_right) = self.scratch.cut(samples);
        (Self { sums, scratch }, Self { sums: right, scratch: scratch_right })
    }
}

impl Conv {
    /// Where a pixel lies in the padded input.
    pub(super) fn input_at(&self, row: usize, column: usize) -> usize {
        ((row + self.before[0]) * self.padded[1] + column + self.before[1]) * self.forward.c_in
    }

    /// Writes what the core put out into the padded input of the next layer.
    fn spread<T: Real>(&self, out: &[T], next: &Self, input: &mut [T]) {
        let origin = next.input_at(0, 0);
        self.runs(next.padded[1] * next.forward.c_in, |core, at, len| {
            input[origin + at..][..len].copy_from_slice(&out[core..core + len]);
        });
    }

    /// The deltas of the core from the gradient with respect to its picture: zero where ReLU put out nothing.
    fn gather<T: Real>(&self, d_picture: &[T], channels: usize, out: &[T], delta: &mut [T]) {
        vectorize(
            #[inline(always)]
            || {
                self.runs(self.output()[1] * channels, |core, at, len| {
                    let d = &d_picture[at..at + len];
                    for ((delta, &out), &d) in delta[core..core + len].iter_mut().zip(&out[core..core + len]).zip(d) {
                        *delta = if out > T::nil() { d } else { T::nil() };
                    }
                });
            },
        );
    }

    /// The gradient with respect to a layer's input, without borders.
    fn d_input<T: Real>(&self, kernels: &Kernels<T>, delta: &[T], l: usize, slot: &mut Slot<T>) {
        let (row, padded) = (self.core[1] * self.forward.c_out, &mut slot.deltas[l]);
        for (r, delta) in delta.chunks_exact(row).enumerate() {
            let at = (r + self.delta_before[0]) * self.delta_padded[1] + self.delta_before[1];
            padded[at * self.forward.c_out..][..row].copy_from_slice(delta);
        }
        for ((grid, _), w) in self.backward.iter().zip(&kernels.backward) {
            correlate(grid, w, &slot.zeros, false, padded, &mut slot.d_input);
        }
    }
}
