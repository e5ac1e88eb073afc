//! The encoder E: observation -> Gaussian over z (means, then log standard deviations).

mod convolutional;
mod dense;
mod shared_frames;

use std::ops::Range;

use super::{
    by_kind::{ByKind, every_kind},
    sizes::{ImageNetworks, Sizes},
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        mlp::{Layout, Linear, Mlp},
    },
    num::Real,
};

pub use convolutional::ConvEncoder;
use convolutional::{ConvEncoderColumns, ConvEncoderPass};
use dense::{DenseEncoderColumns, DenseEncoderPass};
use shared_frames::{SharedFrameEncoder, SharedFrameEncoderColumns, SharedFrameEncoderPass};

/// Where the layers of E are in the arena: two hidden layers, convolutions and one hidden layer, or two hidden layers
/// for every frame.
pub type Encoder = ByKind<Mlp<3>, ConvEncoder, SharedFrameEncoder>;

/// Buffers of E for a batch.
pub(super) type EncoderPass<T> = ByKind<DenseEncoderPass<T>, ConvEncoderPass<T>, SharedFrameEncoderPass<T>>;

/// Some samples of an [`EncoderPass`].
pub(super) type EncoderColumns<'a, T> =
    ByKind<DenseEncoderColumns<'a, T>, ConvEncoderColumns<'a, T>, SharedFrameEncoderColumns<'a, T>>;

impl Encoder {
    /// Lays out the encoder.
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let codes = 2 * sizes.latent;
        match sizes.images {
            ImageNetworks::Dense | ImageNetworks::Patches(_) => {
                let [first, second] = sizes.encoder;
                Self::Dense(layout.mlp("encoder", sizes.entries(), [first, second, codes]))
            }
            ImageNetworks::Convolutional { frames, rows, columns } => {
                Self::Convolutional(ConvEncoder::new(layout, frames, [rows, columns], sizes.encoder, codes))
            }
            ImageNetworks::SharedFrames(frames) => {
                Self::SharedFrames(SharedFrameEncoder::new(layout, frames, sizes.entries(), sizes.encoder))
            }
        }
    }

    /// The layer that puts out the log standard deviations, and which of its outputs they are.
    pub(super) fn log_sigma_outputs(&self) -> (Linear, Range<usize>) {
        let second_half = |layer: Linear| (layer, layer.n_out / 2..layer.n_out);
        match self {
            Self::Dense(net) => second_half(net.layers[2]),
            Self::Convolutional(net) => second_half(net.last()),
            Self::SharedFrames(net) => (net.log_sigma(), 0..net.log_sigma().n_out),
        }
    }
}

impl<T: Real> EncoderPass<T> {
    /// Buffers for `samples` samples of `each` images.
    pub(super) fn new(encoder: &Encoder, samples: usize, each: usize) -> Self {
        match encoder {
            Encoder::Dense(net) => Self::Dense(DenseEncoderPass::new(net, samples, each)),
            Encoder::Convolutional(net) => Self::Convolutional(ConvEncoderPass::new(net, samples, each)),
            Encoder::SharedFrames(net) => Self::SharedFrames(SharedFrameEncoderPass::new(net, samples, each)),
        }
    }

    /// Computes what all samples of a step share; once a step, before [`EncoderPass::view`].
    pub(super) fn pack(&mut self, arena: &[T], images: &BinaryImages) {
        match self {
            Self::Dense(pass) => pass.pack(arena, images),
            Self::SharedFrames(pass) => pass.pack(arena, images),
            Self::Convolutional(pass) => pass.pack(arena),
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> EncoderColumns<'_, T> {
        match self {
            Self::Dense(pass) => EncoderColumns::Dense(pass.view(samples)),
            Self::Convolutional(pass) => EncoderColumns::Convolutional(pass.view(samples)),
            Self::SharedFrames(pass) => EncoderColumns::SharedFrames(pass.view(samples)),
        }
    }

    /// Sets the gradients of all weights over the first `samples` samples, whose images are `which`.
    pub(super) fn gradient(
        &mut self,
        threads: usize,
        arena: &[T],
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        samples: usize,
    ) {
        every_kind!(self, pass => pass.gradient(threads, arena, gradient, (images, which), samples));
    }
}

impl<T: Real> EncoderColumns<'_, T> {
    /// E(·|x) for the images `which`.
    pub(super) fn forward(&mut self, arena: &[T], (images, which): (&BinaryImages, &[u32])) {
        every_kind!(self, columns => columns.forward(arena, (images, which)));
    }

    /// The deltas of the dense layers, from the gradient with respect to the codes.
    pub(super) fn backward(&mut self, arena: &[T]) {
        every_kind!(self, columns => columns.backward(arena));
    }

    /// The Gaussians over z, and the gradient with respect to them.
    pub(super) fn codes(&mut self) -> (&mut [T], &mut [T]) {
        every_kind!(self, columns => columns.codes())
    }
}
