//! Convolutions one after the other, computed image by image.
//!
//! Outputs and deltas of all layers are kept for the whole batch. Padded copies exist once per thread.

use super::{
    Conv, PackedWeights,
    kernels::{accumulate, correlate},
    shard_sums::{PerThread, ShardSums, by_layer},
};
use crate::{
    nn::{
        columns::{Cut, MAX_THREADS},
        mat::Accumulate,
        mlp::{Pass, PassMut, sum_columns},
    },
    num::{Real, simd::vectorize},
};

/// A network of `L` convolutions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stack<const L: usize> {
    /// The layers.
    pub convs: [Conv; L],
}

/// One thread's padded copies of the image at hand. Their borders of zeros are never written.
#[derive(Debug, Clone)]
pub struct ThreadBuffers<T> {
    /// The input of each layer.
    inputs: Vec<Vec<T>>,
    /// The deltas of each layer.
    deltas: Vec<Vec<T>>,
    /// The gradient with respect to the input of one layer, without border.
    d_input: Vec<T>,
}

impl<T: Real> ThreadBuffers<T> {
    fn new(convs: &[Conv]) -> Self {
        let each = |len: fn(&Conv) -> usize| convs.iter().map(|conv| vec![T::ZERO; len(conv)]).collect();
        Self {
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_input: vec![T::ZERO; convs.iter().map(Conv::input_len).max().unwrap_or(0)],
        }
    }
}

/// The buffers of a forward and backward pass.
#[derive(Debug, Clone)]
pub struct StackPass<T, const L: usize> {
    layers: Pass<T, L>,
    per_thread: Vec<ThreadBuffers<T>>,
}

/// Some images of a [`StackPass`].
#[derive(Debug)]
pub struct StackMut<'a, T, const L: usize> {
    /// The output of each core, and its deltas.
    pub layers: PassMut<'a, T, L>,
    per_thread: PerThread<'a, ThreadBuffers<T>>,
}

impl<T: Real, const L: usize> StackPass<T, L> {
    /// Buffers for `samples` samples of `each` images.
    pub fn new(stack: &Stack<L>, samples: usize, each: usize) -> Self {
        let widths = stack.convs.each_ref().map(|conv| conv.width() * each);
        let per_thread = (0..MAX_THREADS).map(|_| ThreadBuffers::new(&stack.convs)).collect();
        Self { layers: Pass::of_widths(widths, samples), per_thread }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> StackMut<'_, T, L> {
        StackMut { layers: self.layers.view(samples), per_thread: PerThread(&mut self.per_thread) }
    }
}

impl<T: Real, const L: usize> Cut for StackMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (left, right) = self.layers.cut(samples);
        let (per_thread, per_thread_right) = self.per_thread.cut(samples);
        (Self { layers: left, per_thread }, Self { layers: right, per_thread: per_thread_right })
    }
}

/// The part of a buffer that belongs to one image.
fn of<T>(buffer: &[T], width: usize, image: usize) -> &[T] {
    &buffer[image * width..][..width]
}

fn of_mut<T>(buffer: &mut [T], width: usize, image: usize) -> &mut [T] {
    &mut buffer[image * width..][..width]
}

impl<const L: usize> Stack<L> {
    /// Buffers for the packed weights of all layers.
    pub fn packed_weights<T: Real>(&self) -> Vec<PackedWeights<T>> {
        self.convs.iter().map(PackedWeights::new).collect()
    }

    /// Packs the weights of all layers; once per training step.
    pub fn pack<T: Real>(&self, arena: &[T], packed: &mut [PackedWeights<T>]) {
        vectorize(
            #[inline(always)]
            || {
                for (conv, packed) in self.convs.iter().zip(packed) {
                    conv.pack(arena, packed);
                }
            },
        );
    }

    /// Runs all layers on every image. `fill` writes an image into the padded input of the first layer.
    pub fn forward<T: Real>(
        &self,
        packed: &[PackedWeights<T>],
        pass: &mut StackMut<'_, T, L>,
        fill: impl Fn(usize, &mut [T]),
    ) {
        let buffers = &mut pass.per_thread.0[0];
        for image in 0..pass.layers.out[0].len() / self.convs[0].width() {
            fill(image, &mut buffers.inputs[0]);
            for (l, (conv, packed)) in self.convs.iter().zip(packed).enumerate() {
                let out = of_mut(pass.layers.out[l], conv.width(), image);
                correlate(&conv.forward, None, &packed.forward, &packed.bias, conv.relu, &buffers.inputs[l], out);
                if let Some(next) = self.convs.get(l + 1) {
                    conv.spread(out, next, &mut buffers.inputs[l + 1]);
                }
            }
        }
    }

    /// Computes the deltas of all layers from those of the last. If `take` is given, it gets the gradient with respect to
    /// each image, without border.
    pub fn backward<T: Real>(
        &self,
        packed: &[PackedWeights<T>],
        pass: &mut StackMut<'_, T, L>,
        mut take: Option<impl FnMut(usize, &[T])>,
    ) {
        let buffers = &mut pass.per_thread.0[0];
        for image in 0..pass.layers.out[0].len() / self.convs[0].width() {
            for l in (0..L).rev() {
                let conv = &self.convs[l];
                if l > 0 || take.is_some() {
                    conv.pad(of(pass.layers.delta[l], conv.width(), image), &mut buffers.deltas[l]);
                    conv.d_input(&packed[l], &buffers.deltas[l], None, &mut buffers.d_input);
                }
                if l > 0 {
                    let before = &self.convs[l - 1];
                    let out = of(pass.layers.out[l - 1], before.width(), image);
                    let delta = of_mut(pass.layers.delta[l - 1], before.width(), image);
                    before.gather(&buffers.d_input, conv.forward.c_in, out, delta);
                } else if let Some(take) = &mut take {
                    take(image, &buffers.d_input[..conv.input_len()]);
                }
            }
        }
    }

    /// Buffers for the weight gradients of the shards of a batch.
    pub fn shard_sums<T: Real>(&self) -> ShardSums<T> {
        ShardSums::new(&self.convs, 0)
    }

    /// Sets the gradients of all weights. `fill` is that of [`Stack::forward`].
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        pass: &mut StackMut<'_, T, L>,
        shards: &mut ShardSums<T>,
        gradient: &mut [T],
        fill: &(impl Fn(usize, &mut [T]) + Sync),
    ) {
        let images = pass.layers.out[0].len() / self.convs[0].width();
        let layers = &pass.layers;
        shards.sum(threads, images, pass.per_thread.0, &|images, sums, buffers| {
            for image in images {
                fill(image, &mut buffers.inputs[0]);
                self.add_gradient(image, layers, buffers, sums);
            }
        });
        shards.unfold(&self.convs, gradient);
    }

    /// Adds one image's gradients to a shard's sums.
    fn add_gradient<T: Real>(
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
            sum_columns(db, Accumulate::Add, delta);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(of(layers.out[l], conv.width(), image), next, &mut buffers.inputs[l + 1]);
            }
        }
    }
}
