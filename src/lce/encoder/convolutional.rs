//! The convolutional encoder of the paper's larger images.

use crate::{
    lce::sizes::CHANNELS,
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, cut_together},
        conv::{Conv, Resize, ShardSums, SparseConvMut, SparseConvPass, SparseConvStack, SparseConvWeights},
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass, PassMut, mask},
    },
    num::Real,
};

/// Where the layers are in the arena: four convolutions of stride 1, 2, 2 and 2, then one hidden layer, with ReLU after
/// each, then the Gaussian.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConvEncoder {
    stack: SparseConvStack<3>,
    dense: Mlp<2>,
}

impl ConvEncoder {
    /// Lays out the encoder for observations of `frames` frames; `flat` numbers leave the convolutions.
    pub(super) fn new(
        layout: &mut Layout,
        frames: usize,
        size: [usize; 2],
        [flat, hidden]: [usize; 2],
        codes: usize,
    ) -> Self {
        let half = |[rows, columns]: [usize; 2]| [rows.div_ceil(2), columns.div_ceil(2)];
        let (size_1, size_2) = (half(size), half(half(size)));
        let [last_rows, last_columns] = half(size_2);
        let last_channels = flat / (last_rows * last_columns);
        let down = |layout: &mut Layout, name, size, c_out| {
            Conv::new(layout, name, size, [CHANNELS, c_out], Resize::Down(2), true)
        };
        let stack = SparseConvStack::new(layout, "encoder", (frames, size), CHANNELS, |layout| {
            [
                down(layout, "encoder.1", size, CHANNELS),
                down(layout, "encoder.2", size_1, CHANNELS),
                down(layout, "encoder.3", size_2, last_channels),
            ]
        });
        Self { stack, dense: layout.mlp("encoder.dense", flat, [hidden, codes]) }
    }

    /// The layer that puts out the Gaussian.
    pub(super) fn last(&self) -> Linear {
        self.dense.layers[1]
    }
}

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(in crate::lce) struct ConvEncoderPass<T> {
    net: ConvEncoder,
    packed: SparseConvWeights<T>,
    stack: SparseConvPass<T, 3>,
    /// The convolutions' output, pixel by pixel, and the gradient with respect to it.
    flat: Block<T>,
    d_flat: Block<T>,
    dense: Pass<T, 2>,
    sums: ShardSums<T>,
}

cut_together! {
    /// Some samples of a [`ConvEncoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct ConvEncoderColumns<'a, T> {
        net: &'a ConvEncoder,
        packed: &'a SparseConvWeights<T>,
        stack: SparseConvMut<'a, T, 3>,
        flat: BlockMut<'a, T>,
        d_flat: BlockMut<'a, T>,
        dense: PassMut<'a, T, 2>,
    }
}

impl<T: Real> ConvEncoderPass<T> {
    pub(super) fn new(net: &ConvEncoder, samples: usize, each: usize) -> Self {
        let ConvEncoder { stack, dense } = net;
        let flat = || Block::new(dense.layers[0].n_in * each, samples);
        Self {
            net: net.clone(),
            packed: stack.packed_weights(),
            stack: SparseConvPass::new(stack, samples, each),
            flat: flat(),
            d_flat: flat(),
            dense: Pass::new(dense, samples, each),
            sums: stack.shard_sums(),
        }
    }

    pub(super) fn pack(&mut self, arena: &[T]) {
        self.net.stack.pack(arena, &mut self.packed);
    }

    pub(super) fn view(&mut self, samples: usize) -> ConvEncoderColumns<'_, T> {
        ConvEncoderColumns {
            net: &self.net,
            packed: &self.packed,
            stack: self.stack.view(samples),
            flat: self.flat.view(samples),
            d_flat: self.d_flat.view(samples),
            dense: self.dense.view(samples),
        }
    }

    pub(super) fn gradient(
        &mut self,
        threads: usize,
        arena: &[T],
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        samples: usize,
    ) {
        let Self { net: ConvEncoder { stack, dense }, packed, stack: pass, flat, d_flat, dense: dense_pass, sums } =
            self;
        let (flat, dense_pass) = (flat.view(samples).data, dense_pass.view(samples));
        dense.gradient(threads, gradient, Accumulate::Replace, flat, &dense_pass);
        let d_flat = &d_flat.view(samples).data;
        stack.gradient(threads, (arena, packed), gradient, (images, which), pass, d_flat, sums);
    }
}

impl<T: Real> ConvEncoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], (images, which): (&BinaryImages, &[u32])) {
        let ConvEncoder { stack, dense } = self.net;
        stack.forward(arena, self.packed, (images, which), &mut self.stack, self.flat.data);
        dense.forward(arena, self.flat.data, &mut self.dense);
    }

    pub(super) fn backward(&mut self, arena: &[T]) {
        self.net.dense.backward(arena, &mut self.dense, Some(self.d_flat.data));
        mask(self.d_flat.data, self.flat.data);
    }

    pub(super) fn codes(&mut self) -> (&mut [T], &mut [T]) {
        self.dense.output_and_delta()
    }
}
