//! The decoder D: z -> Bernoulli logits of an observation.

mod convolutional;
mod dense;
mod shared_frames;

use std::ops::Range;

use super::{
    by_kind::{ByKind, every_kind},
    shared_frames::{FRAMES, Speeds},
    sizes::{ImageNetworks, Sizes},
};
use crate::{
    nn::mlp::{Layout, Mlp},
    num::Real,
};

pub use convolutional::ConvDecoder;
use convolutional::{ConvDecoderColumns, ConvDecoderPass};
use dense::{DenseDecoderColumns, DenseDecoderPass};
use shared_frames::{SharedFrameDecoder, SharedFrameDecoderColumns, SharedFrameDecoderPass};

/// Where the layers of D are in the arena: two hidden layers, two layers and convolutions, or two hidden layers for
/// every frame.
pub type Decoder = ByKind<Mlp<3>, ConvDecoder, SharedFrameDecoder>;

/// Buffers of D for a batch.
pub(super) type DecoderPass<T> = ByKind<DenseDecoderPass<T>, ConvDecoderPass<T>, SharedFrameDecoderPass<T>>;

/// Some samples of a [`DecoderPass`].
pub(super) type DecoderColumns<'a, T> =
    ByKind<DenseDecoderColumns<'a, T>, ConvDecoderColumns<'a, T>, SharedFrameDecoderColumns<'a, T>>;

impl Decoder {
    /// Lays out the decoder.
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        if let Some(Speeds { positions, scale }) = sizes.speeds() {
            let logits = sizes.predicted_entries() / FRAMES;
            return Self::SharedFrames(SharedFrameDecoder::new(layout, positions, scale, sizes.decoder, logits));
        }
        match sizes.images {
            ImageNetworks::Dense | ImageNetworks::Patches(_) | ImageNetworks::SharedFrames(_) => {
                let [first, second] = sizes.decoder;
                Self::Dense(layout.mlp("decoder", sizes.latent, [first, second, sizes.predicted_entries()]))
            }
            ImageNetworks::Convolutional { frames, rows, columns } => {
                Self::Convolutional(ConvDecoder::new(layout, frames, [rows, columns], sizes.latent, sizes.decoder))
            }
        }
    }

    /// The arena's entries that hold its parameters.
    pub(super) fn parameters(&self) -> Range<usize> {
        let (first, last) = match self {
            Self::Dense(net) => (net.layers[0], net.layers[2]),
            Self::Convolutional(net) => net.first_and_last(),
            Self::SharedFrames(net) => net.first_and_last(),
        };
        first.at..last.at + last.len()
    }
}

impl<T: Real> DecoderPass<T> {
    /// Buffers for `samples` samples of `each` codes.
    pub(super) fn new(decoder: &Decoder, samples: usize, each: usize) -> Self {
        match decoder {
            Decoder::Dense(net) => Self::Dense(DenseDecoderPass::new(net, samples, each)),
            Decoder::Convolutional(net) => Self::Convolutional(ConvDecoderPass::new(net, samples, each)),
            Decoder::SharedFrames(net) => Self::SharedFrames(SharedFrameDecoderPass::new(net, samples, each)),
        }
    }

    /// Computes what all samples of a step share; once a step, before [`DecoderPass::view`].
    pub(super) fn pack(&mut self, arena: &[T]) {
        match self {
            Self::Dense(_) | Self::SharedFrames(_) => {}
            Self::Convolutional(pass) => pass.pack(arena),
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> DecoderColumns<'_, T> {
        match self {
            Self::Dense(pass) => DecoderColumns::Dense(pass.view(samples)),
            Self::Convolutional(pass) => DecoderColumns::Convolutional(pass.view(samples)),
            Self::SharedFrames(pass) => DecoderColumns::SharedFrames(pass.view(samples)),
        }
    }

    /// Sets the gradients of all weights over the first `samples` samples, whose codes are the columns `z`.
    pub(super) fn gradient(&mut self, threads: usize, gradient: &mut [T], z: &[T], samples: usize) {
        every_kind!(self, pass => pass.gradient(threads, gradient, z, samples));
    }
}

impl<T: Real> DecoderColumns<'_, T> {
    /// Logits for the columns `z`.
    pub(super) fn forward(&mut self, arena: &[T], z: &[T]) {
        every_kind!(self, columns => columns.forward(arena, z));
    }

    /// The deltas of all layers, from the gradient with respect to the logits. Sets the gradient with respect to z.
    pub(super) fn backward(&mut self, arena: &[T], d_z: &mut [T]) {
        every_kind!(self, columns => columns.backward(arena, d_z));
    }

    /// The logits, and the gradient with respect to them.
    pub(super) fn logits(&mut self) -> (&mut [T], &mut [T]) {
        every_kind!(self, columns => columns.logits())
    }
}
