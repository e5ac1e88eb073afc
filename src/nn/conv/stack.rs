//! Convolutions one after the other, image by image.
//!
//! What every layer puts out and its gradient are kept for the whole batch; padded copies live in a thread's scratch.

use super::{
    Conv, PackedWeights,
    kernels::{accumulate, correlate},
    shard_sums::{PerThread, ShardSums, by_layer},
};
use crate::{
    nn::{
        columns::{Cut, MAX_THREADS},
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

/// A thread's own copies of images with their borders of zeros, which nothing ever writes.
#[derive(Debug, Clone)]
pub struct ThreadBuffers<T> {
    /// The input of each layer.
    inputs: Vec<Vec<T>>,
    /// The deltas of each layer.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to one layer's input, without borders.
    d_input: Vec<T>,
}

/// A buffers for every thread.
#[derive(Debug, Clone)]
pub struct Scratch<T>(Vec<ThreadBuffers<T>>);

impl<T: Real> Scratch<T> {
    fn new<const L: usize>(stack: &Stack<L>) -> Self {
        let each = |len: fn(&Conv) -> usize| stack.convs.iter().map(|conv| vec![T::ZERO; len(conv)]).collect();
        let buffers = || ThreadBuffers {
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_input: vec![T::ZERO; stack.convs.iter().map(Conv::input_len).max().unwrap_or(0)],
        };
        Self((0..MAX_THREADS).map(|_| buffers()).collect())
    }
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
pub struct StackPass<T, const L: usize> {
    layers: Pass<T, L>,
    scratch: Scratch<T>,
}

/// Some images of a [`StackPass`].
#[derive(Debug)]
pub struct StackMut<'a, T, const L: usize> {
    /// What each core put out, and its deltas.
    pub layers: PassMut<'a, T, L>,
    scratch: PerThread<'a, ThreadBuffers<T>>,
}

impl<T: Real, const L: usize> StackPass<T, L> {
    /// Room for `samples` samples of `each` images.
    pub fn new(stack: &Stack<L>, samples: usize, each: usize) -> Self {
        let widths = stack.convs.each_ref().map(|conv| conv.width() * each);
        Self { layers: Pass::of_widths(widths, samples), scratch: Scratch::new(stack) }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> StackMut<'_, T, L> {
        StackMut { layers: self.layers.view(samples), scratch: PerThread(&mut self.scratch.0) }
    }
}

impl<T: Real, const L: usize> Cut for StackMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (left, right) = self.layers.split_at(samples);
        let (scratch, scratch_right) = self.scratch.cut(samples);
        (Self { layers: left, scratch }, Self { layers: right, scratch: scratch_right })
    }
}

/// One image's part of a buffer.
fn of<T>(buffer: &[T], width: usize, image: usize) -> &[T] {
    &buffer[image * width..][..width]
}

fn of_mut<T>(buffer: &mut [T], width: usize, image: usize) -> &mut [T] {
    &mut buffer[image * width..][..width]
}

impl<const L: usize> Stack<L> {
    /// Room for the weights as the loops read them.
    pub fn packed_weights<T: Real>(&self) -> Vec<PackedWeights<T>> {
        self.convs.iter().map(PackedWeights::new).collect()
    }

    /// Fills them in; once a step.
    pub fn pack<T: Real>(&self, arena: &[T], kernels: &mut [PackedWeights<T>]) {
        vectorize(
            #[inline(always)]
            || {
                for (conv, kernels) in self.convs.iter().zip(kernels) {
                    conv.pack(arena, kernels);
                }
            },
        );
    }

    /// All layers on every image; `fill` writes an image into the padded input of the first.
    pub fn forward<T: Real>(
        &self,
        kernels: &[PackedWeights<T>],
        pass: &mut StackMut<'_, T, L>,
        fill: impl Fn(usize, &mut [T]),
    ) {
        let buffers = &mut pass.scratch.0[0];
        for image in 0..pass.layers.out[0].len() / self.convs[0].width() {
            fill(image, &mut buffers.inputs[0]);
            for (l, conv) in self.convs.iter().enumerate() {
                let out = of_mut(pass.layers.out[l], conv.width(), image);
                correlate(
                    &conv.forward,
                    None,
                    &kernels[l].forward,
                    &kernels[l].bias,
                    conv.relu,
                    &buffers.inputs[l],
                    out,
                );
                if let Some(next) = self.convs.get(l + 1) {
                    conv.spread(out, next, &mut buffers.inputs[l + 1]);
                }
            }
        }
    }

    /// Deltas of all layers from those of the last; then, where asked, `take` gets the gradient with respect to each
    /// image, without borders.
    pub fn backward<T: Real>(
        &self,
        kernels: &[PackedWeights<T>],
        pass: &mut StackMut<'_, T, L>,
        mut take: Option<impl FnMut(usize, &[T])>,
    ) {
        let buffers = &mut pass.scratch.0[0];
        for image in 0..pass.layers.out[0].len() / self.convs[0].width() {
            for l in (0..L).rev() {
                let conv = &self.convs[l];
                if l > 0 || take.is_some() {
                    conv.pad(of(pass.layers.delta[l], conv.width(), image), &mut buffers.deltas[l]);
                    conv.d_input(&kernels[l], &buffers.deltas[l], None, &mut buffers.d_input);
                }
                if l > 0 {
                    let before = &self.convs[l - 1];
                    let out = of(pass.layers.out[l - 1], before.width(), image);
                    let delta = of_mut(pass.layers.delta[l - 1], before.width(), image);
                    before.gather(&buffers.d_input, self.convs[l].forward.c_in, out, delta);
                } else if let Some(take) = &mut take {
                    take(image, &buffers.d_input[..conv.input_len()]);
                }
            }
        }
    }

    /// Room for the sums over shares of the batch.
    pub fn shard_sums<T: Real>(&self) -> ShardSums<T> {
        ShardSums::new(&self.convs, 0)
    }

    /// Sets the gradients of all weights. `fill` as in [`Stack::forward`].
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        pass: &mut StackMut<'_, T, L>,
        shares: &mut ShardSums<T>,
        gradient: &mut [T],
        fill: &(impl Fn(usize, &mut [T]) + Sync),
    ) {
        let images = pass.layers.out[0].len() / self.convs[0].width();
        let layers = &pass.layers;
        shares.sum(threads, images, pass.scratch.0, &|images, sums, buffers| {
            for image in images {
                fill(image, &mut buffers.inputs[0]);
                self.picture_gradient(image, layers, buffers, sums);
            }
        });
        shares.unfold(&self.convs, gradient);
    }

    fn picture_gradient<T: Real>(
        &self,
        image: usize,
        layers: &PassMut<'_, T, L>,
        buffers: &mut ThreadBuffers<T>,
        sums: &mut [T],
    ) {
        let (sums, _) = by_layer(&self.convs, sums);
        for (l, (conv, [dw, db])) in self.convs.iter().zip(sums).enumerate() {
            let delta = of(layers.delta[l], conv.width(), image);
            accumulate(&conv.forward, None, &buffers.inputs[l], (delta, conv.forward.out_row), dw);
            crate::nn::mlp::sum_columns(db, crate::nn::mat::Accumulate::Add, delta);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(of(layers.out[l], conv.width(), image), next, &mut buffers.inputs[l + 1]);
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

    /// The deltas of the core from the gradient with respect to its image: zero where ReLU put out nothing.
    fn gather<T: Real>(&self, d_picture: &[T], channels: usize, out: &[T], delta: &mut [T]) {
        vectorize(
            #[inline(always)]
            || {
                self.runs(self.output()[1] * channels, |core, at, len| {
                    let d = &d_picture[at..at + len];
                    for ((delta, &out), &d) in delta[core..core + len].iter_mut().zip(&out[core..core + len]).zip(d) {
                        *delta = if out > T::ZERO { d } else { T::ZERO };
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
