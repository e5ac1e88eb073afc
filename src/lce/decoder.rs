//! D: z -> Bernoulli logits of a picture; fully connected, or convolutional for the paper's larger pictures.

use super::{encoder::CHANNELS, model::Sizes};
use crate::{
    nn::{
        columns::{Block, BlockMut, Cut},
        conv::{Conv, PackedWeights, Resize, ShardSums, Stack, StackMut, StackPass},
        mat::Accumulate,
        mlp::{Layout, Mlp, Pass, PassMut, mask, rectify},
    },
    num::Real,
};

/// Where the layers of D lie in the arena.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "there is one of it in a model")]
pub enum Decoder {
    /// Two hidden layers.
    Dense(Mlp<3>),
    /// Two fully connected layers make a small picture, then three times a convolution and upsampling by 2 before the
    /// last convolution; ReLU between all of them.
    Conv {
        /// The first two layers.
        dense: Mlp<2>,
        /// The convolutions.
        stack: Stack<4>,
    },
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "there is one of it in a workspace")]
pub(super) enum DecoderPass<T> {
    Dense(Pass<T, 3>),
    Conv { dense: Pass<T, 2>, stack: StackPass<T, 4>, logits: Block<T>, delta: Block<T>, shares: ShardSums<T> },
}

/// Some samples of a [`DecoderPass`].
pub(super) enum DecoderMut<'a, T> {
    Dense(PassMut<'a, T, 3>),
    Conv { dense: PassMut<'a, T, 2>, stack: StackMut<'a, T, 4>, logits: BlockMut<'a, T>, delta: BlockMut<'a, T> },
}

impl<T: Real> Cut for DecoderMut<'_, T> {
    fn cut(self, samples: usize) -> (Self, Self) {
        match self {
            Self::Dense(pass) => {
                let (left, right) = pass.cut(samples);
                (Self::Dense(left), Self::Dense(right))
            }
            Self::Conv { dense, stack, logits, delta } => {
                let (dense, stack, logits, delta) =
                    (dense.cut(samples), stack.cut(samples), logits.cut(samples), delta.cut(samples));
                (
                    Self::Conv { dense: dense.0, stack: stack.0, logits: logits.0, delta: delta.0 },
                    Self::Conv { dense: dense.1, stack: stack.1, logits: logits.1, delta: delta.1 },
                )
            }
        }
    }
}

impl<T: Real> DecoderPass<T> {
    /// Room for `samples` samples of `each` codes.
    pub(super) fn new(net: &Decoder, samples: usize, each: usize) -> Self {
        match net {
            Decoder::Dense(mlp) => Self::Dense(Pass::new(mlp, samples, each)),
            Decoder::Conv { dense, stack } => Self::Conv {
                dense: Pass::new(dense, samples, each),
                stack: StackPass::new(stack, samples, each),
                logits: Block::new(stack.convs[3].pixels() * each, samples),
                delta: Block::new(stack.convs[3].pixels() * each, samples),
                shares: stack.shard_sums(),
            },
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> DecoderMut<'_, T> {
        match self {
            Self::Dense(pass) => DecoderMut::Dense(pass.view(samples)),
            Self::Conv { dense, stack, logits, delta, .. } => DecoderMut::Conv {
                dense: dense.view(samples),
                stack: stack.view(samples),
                logits: logits.view(samples),
                delta: delta.view(samples),
            },
        }
    }
}

impl<T: Real> DecoderMut<'_, T> {
    /// Logits, and the gradient with respect to them, to fill in.
    pub(super) fn logits(&mut self) -> (&[T], &mut [T]) {
        match self {
            Self::Dense(pass) => (pass.out[2], pass.delta[2]),
            Self::Conv { logits, delta, .. } => (logits.data, delta.data),
        }
    }
}

impl Decoder {
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let Some([frames, rows, columns]) = sizes.convolution else {
            return Self::Dense(layout.mlp(
                "decoder",
                sizes.latent,
                [sizes.decoder[0], sizes.decoder[1], sizes.entries()],
            ));
        };
        let dense = layout.mlp("decoder.dense", sizes.latent, sizes.decoder);
        let (small, up) = ([rows / 8, columns / 8], Resize::Up([2, 2]));
        let mut conv = |i: usize, scale: usize, channels, resize| {
            let size = small.map(|side| side * scale);
            Conv::new(layout, format!("decoder.{i}"), size, channels, resize, i < 3)
        };
        let thin = sizes.decoder[1] / (small[0] * small[1]);
        let convs = [
            conv(0, 1, [thin, CHANNELS], Resize::Down(1)),
            conv(1, 1, [CHANNELS, CHANNELS], up),
            conv(2, 2, [CHANNELS, CHANNELS], up),
            // Two channels are few: four columns at once fill a vector.
            conv(3, 4, [CHANNELS, frames], Resize::Up([2, 4])),
        ];
        Self::Conv { dense, stack: Stack { convs } }
    }

    /// What all samples of a step share, still to be filled in.
    pub(super) fn packed_weights<T: Real>(&self) -> Vec<PackedWeights<T>> {
        match self {
            Self::Dense(_) => Vec::new(),
            Self::Conv { stack, .. } => stack.packed_weights(),
        }
    }

    /// Fills it in; once a step.
    pub(super) fn pack<T: Real>(&self, arena: &[T], kernels: &mut [PackedWeights<T>]) {
        if let Self::Conv { stack, .. } = self {
            stack.pack(arena, kernels);
        }
    }

    /// Logits for columns of z.
    pub(super) fn forward<T: Real>(
        &self,
        arena: &[T],
        kernels: &[PackedWeights<T>],
        z: &[T],
        pass: &mut DecoderMut<'_, T>,
    ) {
        match (self, pass) {
            (Self::Dense(mlp), DecoderMut::Dense(pass)) => mlp.forward(arena, z, pass),
            (Self::Conv { dense, stack }, DecoderMut::Conv { dense: dense_pass, stack: pass, logits, .. }) => {
                dense.forward(arena, z, dense_pass);
                rectify(dense_pass.out[1]);
                let flat = &*dense_pass.out[1];
                stack.forward(kernels, pass, |i, input| stack.convs[0].fill(flat, i, input));
                let last = &stack.convs[3];
                let outs = pass.layers.out[3].chunks_exact(last.width());
                for (out, logits) in outs.zip(logits.data.chunks_exact_mut(last.pixels())) {
                    last.to_frames(out, logits);
                }
            }
            _ => unreachable!("made by another decoder"),
        }
    }

    /// Deltas of all layers from the gradient with respect to the logits; sets that with respect to z.
    pub(super) fn backward<T: Real>(
        &self,
        arena: &[T],
        kernels: &[PackedWeights<T>],
        pass: &mut DecoderMut<'_, T>,
        d_z: &mut [T],
    ) {
        match (self, pass) {
            (Self::Dense(mlp), DecoderMut::Dense(pass)) => mlp.backward(arena, pass, Some(d_z)),
            (Self::Conv { dense, stack }, DecoderMut::Conv { dense: dense_pass, stack: pass, delta, .. }) => {
                let last = &stack.convs[3];
                let deltas = pass.layers.delta[3].chunks_exact_mut(last.width());
                for (frames, delta) in delta.data.chunks_exact(last.pixels()).zip(deltas) {
                    last.from_frames(frames, delta);
                }
                let d_flat = &mut *dense_pass.delta[1];
                stack.backward(kernels, pass, Some(|i: usize, d: &[T]| stack.convs[0].take(d, d_flat, i)));
                mask(dense_pass.delta[1], dense_pass.out[1]);
                dense.backward(arena, dense_pass, Some(d_z));
            }
            _ => unreachable!("made by another decoder"),
        }
    }

    /// Sets the gradients of all weights over the whole batch.
    pub(super) fn gradient<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        z: &[T],
        pass: &mut DecoderPass<T>,
        samples: usize,
    ) {
        match (self, pass) {
            (Self::Dense(mlp), DecoderPass::Dense(pass)) => {
                mlp.gradient(threads, gradient, Accumulate::Replace, z, &pass.view(samples));
            }
            (Self::Conv { dense, stack }, DecoderPass::Conv { dense: dense_pass, stack: pass, shares, .. }) => {
                let dense_pass = dense_pass.view(samples);
                dense.gradient(threads, gradient, Accumulate::Replace, z, &dense_pass);
                let flat = &*dense_pass.out[1];
                let fill = |i: usize, input: &mut [T]| stack.convs[0].fill(flat, i, input);
                stack.gradient(threads, &mut pass.view(samples), shares, gradient, &fill);
            }
            _ => unreachable!("made by another decoder"),
        }
    }

    /// The arena's entries of its parameters.
    pub(super) fn parameters(&self) -> std::ops::Range<usize> {
        let (first, last) = match self {
            Self::Dense(mlp) => (mlp.layers[0], mlp.layers[2]),
            Self::Conv { dense, stack } => (dense.layers[0], stack.convs[3].weights),
        };
        first.at..last.at + last.len()
    }
}
