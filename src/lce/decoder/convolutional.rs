//! The convolutional decoder of the paper's larger images.

use crate::{
    lce::sizes::CHANNELS,
    nn::{
        columns::{Block, BlockMut, cut_together},
        conv::{Conv, PackedWeights, Resize, ShardSums, Stack, StackMut, StackPass},
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass, PassMut, mask, rectify},
    },
    num::Real,
};

/// Where the layers are in the arena: two fully connected layers make a small image, which three convolutions with
/// upsampling by 2 and a last convolution enlarge, with ReLU between all layers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConvDecoder {
    dense: Mlp<2>,
    stack: Stack<4>,
}

impl ConvDecoder {
    /// Lays out the decoder for observations of `frames` frames. The last of the `hidden` widths is the small image.
    pub(super) fn new(layout: &mut Layout, frames: usize, size: [usize; 2], latent: usize, hidden: [usize; 2]) -> Self {
        let dense = layout.mlp("decoder.dense", latent, hidden);
        let (small, up) = (size.map(|side| side / 8), Resize::Up([2, 2]));
        let mut conv = |i: usize, scale: usize, channels, resize| {
            let size = small.map(|side| side * scale);
            Conv::new(layout, format!("decoder.{i}"), size, channels, resize, i < 3)
        };
        let first_channels = hidden[1] / (small[0] * small[1]);
        let convs = [
            conv(0, 1, [first_channels, CHANNELS], Resize::Down(1)),
            conv(1, 1, [CHANNELS, CHANNELS], up),
            conv(2, 2, [CHANNELS, CHANNELS], up),
            // One or two frames are few channels: four columns at once fill a vector register.
            conv(3, 4, [CHANNELS, frames], Resize::Up([2, 4])),
        ];
        Self { dense, stack: Stack { convs } }
    }

    /// Its first and its last layer in the arena.
    pub(super) fn first_and_last(&self) -> (Linear, Linear) {
        (self.dense.layers[0], self.last().weights)
    }

    fn last(&self) -> &Conv {
        &self.stack.convs[3]
    }
}

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(in crate::lce) struct ConvDecoderPass<T> {
    net: ConvDecoder,
    packed: Vec<PackedWeights<T>>,
    dense: Pass<T, 2>,
    stack: StackPass<T, 4>,
    /// Logits frame by frame, and the gradient with respect to them.
    logits: Block<T>,
    d_logits: Block<T>,
    sums: ShardSums<T>,
}

cut_together! {
    /// Some samples of a [`ConvDecoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct ConvDecoderColumns<'a, T> {
        net: &'a ConvDecoder,
        packed: &'a [PackedWeights<T>],
        dense: PassMut<'a, T, 2>,
        stack: StackMut<'a, T, 4>,
        logits: BlockMut<'a, T>,
        d_logits: BlockMut<'a, T>,
    }
}

impl<T: Real> ConvDecoderPass<T> {
    pub(super) fn new(net: &ConvDecoder, samples: usize, each: usize) -> Self {
        let logits = || Block::new(net.last().pixels() * each, samples);
        Self {
            net: net.clone(),
            packed: net.stack.packed_weights(),
            dense: Pass::new(&net.dense, samples, each),
            stack: StackPass::new(&net.stack, samples, each),
            logits: logits(),
            d_logits: logits(),
            sums: net.stack.shard_sums(),
        }
    }

    pub(super) fn pack(&mut self, arena: &[T]) {
        self.net.stack.pack(arena, &mut self.packed);
    }

    pub(super) fn view(&mut self, samples: usize) -> ConvDecoderColumns<'_, T> {
        ConvDecoderColumns {
            net: &self.net,
            packed: &self.packed,
            dense: self.dense.view(samples),
            stack: self.stack.view(samples),
            logits: self.logits.view(samples),
            d_logits: self.d_logits.view(samples),
        }
    }

    pub(super) fn gradient(&mut self, threads: usize, gradient: &mut [T], z: &[T], samples: usize) {
        let Self { net: ConvDecoder { dense, stack }, dense: dense_pass, stack: pass, sums, .. } = self;
        let dense_pass = dense_pass.view(samples);
        dense.gradient(threads, gradient, Accumulate::Replace, z, &dense_pass);
        let flat = dense_pass.output();
        let fill = |i: usize, input: &mut [T]| stack.convs[0].fill(flat, i, input);
        stack.gradient(threads, &mut pass.view(samples), sums, gradient, &fill);
    }
}

impl<T: Real> ConvDecoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], z: &[T]) {
        let ConvDecoder { dense, stack } = self.net;
        dense.forward(arena, z, &mut self.dense);
        let (flat, _) = self.dense.output_and_delta();
        rectify(flat);
        stack.forward(self.packed, &mut self.stack, |i, input| stack.convs[0].fill(flat, i, input));
        let last = self.net.last();
        let outs = self.stack.layers.output().chunks_exact(last.width());
        for (out, logits) in outs.zip(self.logits.data.chunks_exact_mut(last.pixels())) {
            last.to_frames(out, logits);
        }
    }

    pub(super) fn backward(&mut self, arena: &[T], d_z: &mut [T]) {
        let ConvDecoder { dense, stack } = self.net;
        let last = self.net.last();
        let deltas = self.stack.layers.output_delta().chunks_exact_mut(last.width());
        for (frames, delta) in self.d_logits.data.chunks_exact(last.pixels()).zip(deltas) {
            last.from_frames(frames, delta);
        }
        let (flat, d_flat) = self.dense.output_and_delta();
        stack.backward(self.packed, &mut self.stack, Some(|i: usize, d: &[T]| stack.convs[0].take(d, d_flat, i)));
        mask(d_flat, flat);
        dense.backward(arena, &mut self.dense, Some(d_z));
    }

    pub(super) fn logits(&mut self) -> (&mut [T], &mut [T]) {
        (self.logits.data, self.d_logits.data)
    }
}
