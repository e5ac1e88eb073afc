//! Convolutions one after the other, picture by picture.
//!
//! What every layer puts out and its gradient are kept for the whole batch; padded copies live in a thread's scratch.

use super::{
    Conv, Kernels,
    kernels::{accumulate, correlate},
    shares::{Shares, Slots, by_layer},
};
use crate::{
    nn::{
        columns::{Cut, MOST_THREADS},
        mlp::{Pass, PassMut},
    },
    num::{Real, simd::vectorize},
};

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
    inputs: Vec<Vec<T>>,
    /// The deltas of each layer.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to one layer's input, without borders.
    d_input: Vec<T>,
}

/// A slot for every thread.
#[derive(Debug, Clone)]
pub struct Scratch<T>(Vec<Slot<T>>);

impl<T: Real> Scratch<T> {
    fn new<const L: usize>(stack: &Stack<L>) -> Self {
        let each = |len: fn(&Conv) -> usize| stack.convs.iter().map(|conv| vec![T::nil(); len(conv)]).collect();
        let slot = || Slot {
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_input: vec![T::nil(); stack.convs.iter().map(Conv::input_len).max().unwrap_or(0)],
        };
        Self((0..MOST_THREADS).map(|_| slot()).collect())
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
    scratch: Slots<'a, Slot<T>>,
}

impl<T: Real, const L: usize> StackPass<T, L> {
    /// Room for `samples` samples of `each` pictures.
    pub fn new(stack: &Stack<L>, samples: usize, each: usize) -> Self {
        let widths = stack.convs.each_ref().map(|conv| conv.width() * each);
        Self { layers: Pass::of_widths(widths, samples), scratch: Scratch::new(stack) }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> StackMut<'_, T, L> {
        StackMut { layers: self.layers.view(samples), scratch: Slots(&mut self.scratch.0) }
    }
}

impl<T: Real, const L: usize> Cut for StackMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (left, right) = self.layers.split_at(samples);
        let (scratch, scratch_right) = self.scratch.cut(samples);
        (Self { layers: left, scratch }, Self { layers: right, scratch: scratch_right })
    }
}

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
                correlate(&conv.forward, None, &kernels[l].forward, &kernels[l].bias, conv.relu, &slot.inputs[l], out);
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
                if l > 0 || take.is_some() {
                    conv.pad(of(pass.layers.delta[l], conv.width(), picture), &mut slot.deltas[l]);
                    conv.d_input(&kernels[l], &slot.deltas[l], None, &mut slot.d_input);
                }
                if l > 0 {
                    let before = &self.convs[l - 1];
                    let out = of(pass.layers.out[l - 1], before.width(), picture);
                    let delta = of_mut(pass.layers.delta[l - 1], before.width(), picture);
                    before.gather(&slot.d_input, self.convs[l].forward.c_in, out, delta);
                } else if let Some(take) = &mut take {
                    take(picture, &slot.d_input[..conv.input_len()]);
                }
            }
        }
    }

    /// Room for the sums over shares of the batch.
    pub fn shares<T: Real>(&self) -> Shares<T> {
        Shares::new(&self.convs, 0)
    }

    /// Sets the gradients of all weights. `fill` as in [`Stack::forward`].
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        pass: &mut StackMut<'_, T, L>,
        shares: &mut Shares<T>,
        gradient: &mut [T],
        fill: &(impl Fn(usize, &mut [T]) + Sync),
    ) {
        let pictures = pass.layers.out[0].len() / self.convs[0].width();
        let layers = &pass.layers;
        shares.sum(threads, pictures, pass.scratch.0, &|pictures, sums, slot| {
            for picture in pictures {
                fill(picture, &mut slot.inputs[0]);
                self.picture_gradient(picture, layers, slot, sums);
            }
        });
        shares.unfold(&self.convs, gradient);
    }

    fn picture_gradient<T: Real>(
        &self,
        picture: usize,
        layers: &PassMut<'_, T, L>,
        slot: &mut Slot<T>,
        sums: &mut [T],
    ) {
        let (sums, _) = by_layer(&self.convs, sums);
        for (l, (conv, [dw, db])) in self.convs.iter().zip(sums).enumerate() {
            let delta = of(layers.delta[l], conv.width(), picture);
            accumulate(&conv.forward, None, &slot.inputs[l], (delta, conv.forward.out_row), dw);
            crate::nn::mlp::sum_columns(db, crate::nn::mat::Into::Add, delta);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(of(layers.out[l], conv.width(), picture), next, &mut slot.inputs[l + 1]);
            }
        }
    }
}

impl Conv {
    /// Writes what the core put out into the padded input of the next layer.
    pub(super) fn spread<T: Real>(&self, out: &[T], next: &Self, input: &mut [T]) {
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

    /// Writes deltas into the padded buffer, whose border stays zero.
    fn pad<T: Copy>(&self, delta: &[T], padded: &mut [T]) {
        let row = self.core[1] * self.forward.c_out;
        for (r, delta) in delta.chunks_exact(row).enumerate() {
            padded[self.delta_at(r, 0)..][..row].copy_from_slice(delta);
        }
    }
}
