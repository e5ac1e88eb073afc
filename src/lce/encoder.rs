//! E: picture -> Gaussian over z; fully connected, or convolutional for the paper's larger pictures.

use super::model::Sizes;
use crate::{
    nn::{
        binary_images::{BinaryImages, OutputRows},
        columns::{Block, BlockMut, Cut},
        conv::{Conv, Resize, ShardSums, SparseConvMut, SparseConvPass, SparseConvStack, SparseConvWeights},
        mat::Accumulate,
        mlp::{Layout, Mlp, Pass, PassMut, mask},
    },
    num::Real,
};

/// Channels between convolutions (paper, appendix "Network Architectures").
pub(super) const CHANNELS: usize = 32;

/// Where the layers of E lie in the arena.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "there is one of it in a model")]
pub enum Encoder {
    /// Two hidden layers.
    Dense(Mlp<3>),
    /// Four convolutions, of stride 1, 2, 2 and 2, then one hidden layer; ReLU after each.
    Conv {
        /// The convolutions.
        stack: SparseConvStack<3>,
        /// What follows.
        dense: Mlp<2>,
    },
}

/// What all samples of a step share.
#[derive(Debug, Clone)]
pub(super) enum EncoderWeights<T> {
    /// W x_background + b of the first layer.
    Dense(Vec<T>),
    Conv(SparseConvWeights<T>),
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "there is one of it in a workspace")]
pub(super) enum EncoderPass<T> {
    Dense(Pass<T, 3>),
    Conv { stack: SparseConvPass<T, 3>, flat: Block<T>, d_flat: Block<T>, dense: Pass<T, 2>, shares: ShardSums<T> },
}

/// Some samples of an [`EncoderPass`].
pub(super) enum EncoderMut<'a, T> {
    Dense(PassMut<'a, T, 3>),
    Conv { stack: SparseConvMut<'a, T, 3>, flat: BlockMut<'a, T>, d_flat: BlockMut<'a, T>, dense: PassMut<'a, T, 2> },
}

impl<T: Real> Cut for EncoderMut<'_, T> {
    fn cut(self, samples: usize) -> (Self, Self) {
        match self {
            Self::Dense(pass) => {
                let (left, right) = pass.cut(samples);
                (Self::Dense(left), Self::Dense(right))
            }
            Self::Conv { stack, flat, d_flat, dense } => {
                let (stack, flat, d_flat, dense) =
                    (stack.cut(samples), flat.cut(samples), d_flat.cut(samples), dense.cut(samples));
                (
                    Self::Conv { stack: stack.0, flat: flat.0, d_flat: d_flat.0, dense: dense.0 },
                    Self::Conv { stack: stack.1, flat: flat.1, d_flat: d_flat.1, dense: dense.1 },
                )
            }
        }
    }
}

impl<T: Real> EncoderPass<T> {
    /// Room for `samples` samples of `each` pictures.
    pub(super) fn new(net: &Encoder, samples: usize, each: usize) -> Self {
        match net {
            Encoder::Dense(mlp) => Self::Dense(Pass::new(mlp, samples, each)),
            Encoder::Conv { stack, dense } => Self::Conv {
                stack: SparseConvPass::new(stack, samples, each),
                flat: Block::new(dense.layers[0].n_in * each, samples),
                d_flat: Block::new(dense.layers[0].n_in * each, samples),
                dense: Pass::new(dense, samples, each),
                shares: stack.shard_sums(),
            },
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> EncoderMut<'_, T> {
        match self {
            Self::Dense(pass) => EncoderMut::Dense(pass.view(samples)),
            Self::Conv { stack, flat, d_flat, dense, .. } => EncoderMut::Conv {
                stack: stack.view(samples),
                flat: flat.view(samples),
                d_flat: d_flat.view(samples),
                dense: dense.view(samples),
            },
        }
    }
}

impl<T: Real> EncoderMut<'_, T> {
    /// The Gaussians over z, and the gradient with respect to them, to fill in.
    pub(super) fn codes(&mut self) -> (&[T], &mut [T]) {
        match self {
            Self::Dense(pass) => (pass.out[2], pass.delta[2]),
            Self::Conv { dense, .. } => (dense.out[1], dense.delta[1]),
        }
    }
}

impl Encoder {
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let codes = 2 * sizes.latent;
        let Some([frames, rows, columns]) = sizes.convolution else {
            return Self::Dense(layout.mlp("encoder", sizes.entries(), [sizes.encoder[0], sizes.encoder[1], codes]));
        };
        let [flat, hidden] = sizes.encoder;
        let half = |[rows, columns]: [usize; 2]| [rows.div_ceil(2), columns.div_ceil(2)];
        let (size_1, size_2) = (half([rows, columns]), half(half([rows, columns])));
        let [last_rows, last_columns] = half(size_2);
        let thin = flat / (last_rows * last_columns);
        let down = |layout: &mut Layout, name, size, c_out| {
            Conv::new(layout, name, size, [CHANNELS, c_out], Resize::Down(2), true)
        };
        let stack = SparseConvStack::new(layout, "encoder", (frames, [rows, columns]), CHANNELS, |layout| {
            [
                down(layout, "encoder.1", [rows, columns], CHANNELS),
                down(layout, "encoder.2", size_1, CHANNELS),
                down(layout, "encoder.3", size_2, thin),
            ]
        });
        Self::Conv { stack, dense: layout.mlp("encoder.dense", flat, [hidden, codes]) }
    }

    /// What all samples of a step share, still to be filled in.
    pub(super) fn packed_weights<T: Real>(&self) -> EncoderWeights<T> {
        match self {
            Self::Dense(mlp) => EncoderWeights::Dense(vec![T::ZERO; mlp.layers[0].n_out]),
            Self::Conv { stack, .. } => EncoderWeights::Conv(stack.packed_weights()),
        }
    }

    /// Fills it in; once a step.
    pub(super) fn pack<T: Real>(&self, arena: &[T], pictures: &BinaryImages, packed: &mut EncoderWeights<T>) {
        match (self, packed) {
            (Self::Dense(mlp), EncoderWeights::Dense(base)) => pictures.base(&mlp.layers[0], arena, base),
            (Self::Conv { stack, .. }, EncoderWeights::Conv(packed)) => stack.pack(arena, packed),
            _ => unreachable!("made by another encoder"),
        }
    }

    /// E(·|x) for the pictures `which`.
    pub(super) fn forward<T: Real>(
        &self,
        arena: &[T],
        packed: &EncoderWeights<T>,
        (pictures, which): (&BinaryImages, &[u32]),
        pass: &mut EncoderMut<'_, T>,
    ) {
        match (self, packed, pass) {
            (Self::Dense(mlp), EncoderWeights::Dense(base), EncoderMut::Dense(pass)) => {
                let place = OutputRows { stride: mlp.layers[0].n_out, offset: 0 };
                pictures.affine(&mlp.layers[0], arena, base, which, pass.out[0], place, true);
                mlp.forward_from_second(arena, pass);
            }
            (
                Self::Conv { stack, dense },
                EncoderWeights::Conv(packed),
                EncoderMut::Conv { stack: pass, flat, dense: dense_pass, .. },
            ) => {
                stack.forward(arena, packed, (pictures, which), pass, flat.data);
                dense.forward(arena, flat.data, dense_pass);
            }
            _ => unreachable!("made by another encoder"),
        }
    }

    /// Deltas of the dense layers from the gradient with respect to the Gaussians.
    pub(super) fn backward<T: Real>(&self, arena: &[T], pass: &mut EncoderMut<'_, T>) {
        match (self, pass) {
            (Self::Dense(mlp), EncoderMut::Dense(pass)) => mlp.backward(arena, pass, None),
            (Self::Conv { dense, .. }, EncoderMut::Conv { flat, d_flat, dense: pass, .. }) => {
                dense.backward(arena, pass, Some(d_flat.data));
                mask(d_flat.data, flat.data);
            }
            _ => unreachable!("made by another encoder"),
        }
    }

    /// Sets the gradients of all weights over the whole batch.
    pub(super) fn gradient<T: Real>(
        &self,
        threads: usize,
        (arena, packed): (&[T], &EncoderWeights<T>),
        gradient: &mut [T],
        (pictures, which): (&BinaryImages, &[u32]),
        pass: &mut EncoderPass<T>,
        samples: usize,
    ) {
        match (self, packed, pass) {
            (Self::Dense(mlp), _, EncoderPass::Dense(pass)) => {
                let (first, pass) = (&mlp.layers[0], pass.view(samples));
                let place = OutputRows { stride: first.n_out, offset: 0 };
                pictures.gradient(threads, first, gradient, which, pass.delta[0], place);
                mlp.gradient_from_second(threads, gradient, Accumulate::Replace, &pass);
            }
            (
                Self::Conv { stack, dense },
                EncoderWeights::Conv(packed),
                EncoderPass::Conv { stack: pass, flat, d_flat, dense: dense_pass, shares },
            ) => {
                dense.gradient(
                    threads,
                    gradient,
                    Accumulate::Replace,
                    flat.view(samples).data,
                    &dense_pass.view(samples),
                );
                let d_flat = &d_flat.view(samples).data;
                stack.gradient(threads, (arena, packed), gradient, (pictures, which), pass, d_flat, shares);
            }
            _ => unreachable!("made by another encoder"),
        }
    }
}
