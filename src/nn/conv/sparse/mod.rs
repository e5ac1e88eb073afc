//! Convolutions of binary images, of which a few per cent of the pixels are lit.
//!
//! Away from lit pixels, every layer's output is that for the blank image, which is computed once per training step. So
//! for each image only the *active* pixels are computed: in every row one run, as far as a lit pixel reaches. The backward
//! pass is linear in the deltas. All inactive pixels of all images together are therefore one blank image with the sum of
//! their deltas. This is exact, not an approximation.

mod active_rows;
mod first_layer;
#[cfg(test)]
mod tests;
mod thread_buffers;
mod weights;

pub(super) use active_rows::ActiveRows;
pub use thread_buffers::ThreadBuffers;
pub use weights::SparseConvWeights;

use first_layer::FirstLayer;

use super::{
    Conv,
    kernels::{accumulate, correlate},
    shard_sums::{PerThread, ShardSums, by_layer},
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, Cut, MAX_THREADS},
        mat::Accumulate,
        mlp::{Layout, sum_columns},
    },
    num::Real,
};

/// A sparse convolution of stride 1 on observations, then `L` convolutions, with ReLU after each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparseConvStack<const L: usize> {
    first: FirstLayer,
    convs: [Conv; L],
}

/// The buffers of a forward and backward pass.
#[derive(Debug, Clone)]
pub struct SparseConvPass<T, const L: usize> {
    /// The output of each layer at an image's active pixels. The last layer's is complete.
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
    /// Buffers for `samples` samples of `each` images.
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

impl<const L: usize> SparseConvStack<L> {
    /// Lays out the first layer, on `frames` frames of `size` rows and columns, then the layers of `convs`.
    pub fn new(
        layout: &mut Layout,
        name: &str,
        (frames, size): (usize, [usize; 2]),
        channels: usize,
        convs: impl FnOnce(&mut Layout) -> [Conv; L],
    ) -> Self {
        let first = FirstLayer::new(layout, &format!("{name}.0"), frames, size, channels);
        Self { first, convs: convs(layout) }
    }

    fn top(&self) -> &Conv {
        &self.convs[L - 1]
    }

    /// Puts an image into the buffers: its active rows, and the first layer's output there.
    fn show<T: Real>(
        &self,
        (arena, weights): (&[T], &SparseConvWeights<T>),
        (images, image): (&BinaryImages, u32),
        buffers: &mut ThreadBuffers<T>,
    ) {
        let ThreadBuffers { lit_runs, active_rows, inputs, .. } = buffers;
        self.first.lit_runs(images, image, lit_runs);
        let (first, others) = active_rows.split_at_mut(1);
        self.first.active_rows(lit_runs, &mut first[0]);
        let mut before = &first[0];
        for (conv, active_rows) in self.convs.iter().zip(others) {
            active_rows.after(conv, before);
            before = active_rows;
        }
        self.first.forward((arena, &weights.tap_sums), (lit_runs, &first[0]), &self.convs[0], &mut inputs[0]);
    }

    /// Computes the last layer's true output for the images `which`, pixel by pixel, into `flat`.
    pub fn forward<T: Real>(
        &self,
        arena: &[T],
        weights: &SparseConvWeights<T>,
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut SparseConvMut<'_, T, L>,
        flat: &mut [T],
    ) {
        let buffers = &mut pass.per_thread.0[0];
        buffers.clear(weights);
        for ((i, &image), flat) in which.iter().enumerate().zip(flat.chunks_exact_mut(self.top().pixels())) {
            self.show((arena, weights), (images, image), buffers);
            for (l, (conv, packed)) in self.convs.iter().zip(&weights.packed).enumerate() {
                let out = &mut pass.outs[l].data[i * conv.width()..][..conv.width()];
                if l + 1 == L {
                    out.copy_from_slice(&weights.blank_outs[l]);
                }
                let runs = Some(buffers.active_rows[l + 1].runs());
                correlate(&conv.forward, runs, &packed.forward, &packed.bias, conv.relu, &buffers.inputs[l], out);
                buffers.pass_on(&self.convs, l, out);
            }
            self.top().flatten(&pass.outs[L - 1].data[i * self.top().width()..], flat);
            buffers.restore(&self.convs, weights);
        }
    }

    /// Buffers for the weight gradients of the shards of a batch.
    pub fn shard_sums<T: Real>(&self) -> ShardSums<T> {
        ShardSums::new(&self.convs, self.first.tap_sums() + self.first.weights.n_out)
    }

    /// Sets the gradients of all weights. `d_flat` is the gradient with respect to the output of
    /// [`SparseConvStack::forward`], already zero wherever that output is 0.
    #[allow(clippy::too_many_arguments, reason = "a backward pass names its inputs and where its gradients go")]
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        (arena, weights): (&[T], &SparseConvWeights<T>),
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut SparseConvPass<T, L>,
        d_flat: &[T],
        shards: &mut ShardSums<T>,
    ) {
        let outs = &pass.outs;
        shards.sum(threads, which.len(), &mut pass.per_thread, &|images_of_shard, sums, buffers| {
            buffers.begin_shard(weights);
            let (mut sums, first_sums) = by_layer(&self.convs, sums);
            for i in images_of_shard {
                let out = |l: usize| &outs[l].data[i * self.convs[l].width()..][..self.convs[l].width()];
                self.show((arena, weights), (images, which[i]), buffers);
                (0..L - 1).for_each(|l| buffers.pass_on(&self.convs, l, out(l)));
                buffers.take_top(self.top(), &d_flat[i * self.top().pixels()..]);
                self.add_active_gradient(weights, &out, buffers, &mut sums, first_sums);
                buffers.restore(&self.convs, weights);
            }
            self.add_blank_gradient(arena, weights, buffers, &mut sums, first_sums);
        });
        let first_sums = shards.unfold(&self.convs, gradient);
        self.first.unfold(first_sums, gradient);
    }

    /// Adds the gradients from an image's active pixels. `out` is the output of a layer.
    fn add_active_gradient<'a, T: Real>(
        &self,
        weights: &SparseConvWeights<T>,
        out: &impl Fn(usize) -> &'a [T],
        buffers: &mut ThreadBuffers<T>,
        sums: &mut [[&mut [T]; 2]; L],
        first_sums: &mut [T],
    ) {
        for (l, conv) in self.convs.iter().enumerate().rev() {
            buffers.rectify_deltas(conv, l, None, out(l));
            let (runs, deltas) = (Some(buffers.active_rows[l + 1].runs()), conv.deltas(&buffers.deltas[l]));
            accumulate(&conv.forward, runs, &buffers.inputs[l], deltas, sums[l][0]);
            let within = Some((&buffers.active_rows[l], &mut buffers.phase_runs));
            conv.d_input(&weights.packed[l], &buffers.deltas[l], within, &mut buffers.d_out);
        }
        let ThreadBuffers { lit_runs, active_rows, inputs, d_out, first_before_relu, .. } = buffers;
        let image = (&lit_runs[..], &active_rows[0]);
        self.first.gradient(image, &self.convs[0], &inputs[0], d_out, first_sums, first_before_relu);
    }

    /// Adds the gradients from the inactive pixels of a shard's images, and the bias gradients from all pixels.
    fn add_blank_gradient<T: Real>(
        &self,
        arena: &[T],
        weights: &SparseConvWeights<T>,
        buffers: &mut ThreadBuffers<T>,
        sums: &mut [[&mut [T]; 2]; L],
        first_sums: &mut [T],
    ) {
        buffers.d_out[..buffers.sum_top.len()].copy_from_slice(&buffers.sum_top);
        for (l, conv) in self.convs.iter().enumerate().rev() {
            // The gradient at all pixels of all images less the gradient at active pixels.
            for (d_out, &active) in buffers.d_out.iter_mut().zip(&buffers.sums_before_relu[l]) {
                *d_out -= active;
            }
            buffers.rectify_deltas(conv, l, Some(&weights.whole[l]), &weights.blank_outs[l]);
            let [dw, db] = &mut sums[l];
            accumulate(&conv.forward, None, &weights.blank_inputs[l], conv.deltas(&buffers.deltas[l]), dw);
            let row = conv.core[1] * conv.forward.c_out;
            for r in 0..conv.core[0] {
                sum_columns(db, Accumulate::Add, &buffers.sums[l][conv.delta_at(r, 0)..][..row]);
            }
            conv.d_input(&weights.packed[l], &buffers.sums[l], None, &mut buffers.d_out);
        }
        self.first.blank_gradient(arena, &buffers.d_out, &mut buffers.first_before_relu, first_sums);
    }
}
