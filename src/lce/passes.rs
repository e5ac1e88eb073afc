//! Buffers and steps that the loss and the warm-up share: E on x and x', F, D, and the passive dynamics.

use super::{
    anchor::{Anchor, Push},
    decoder::{DecoderColumns, DecoderPass},
    dynamics::{DynamicsColumns, DynamicsPass},
    encoder::{EncoderColumns, EncoderPass},
    gaussian_pair::GaussianPair,
    model::LceModel,
    passive_dynamics::{PassiveColumns, PassivePass},
    sizes::Sizes,
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, cut_together},
        heads,
        mat::Accumulate,
    },
    num::Real,
};

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(super) struct Passes<T> {
    pub(super) encoder: EncoderPass<T>,
    pub(super) decoder_input: Block<T>,
    d_decoder_input: Block<T>,
    decoder: DecoderPass<T>,
    dynamics_input: Block<T>,
    d_dynamics_input: Block<T>,
    dynamics: DynamicsPass<T>,
    passive: PassivePass<T>,
    /// The gradient of all parameters.
    pub(super) gradient: Vec<T>,
}

cut_together! {
    /// Some samples of [`Passes`].
    pub(super) struct PassColumns<'a, T> {
        pub(super) encoder: EncoderColumns<'a, T>,
        pub(super) decoder_input: BlockMut<'a, T>,
        pub(super) d_decoder_input: BlockMut<'a, T>,
        pub(super) decoder: DecoderColumns<'a, T>,
        pub(super) dynamics_input: BlockMut<'a, T>,
        pub(super) d_dynamics_input: BlockMut<'a, T>,
        pub(super) dynamics: DynamicsColumns<'a, T>,
        pub(super) passive: PassiveColumns<'a, T>,
    }
}

/// How often networks run for one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct PerSample {
    /// Codes that D decodes.
    pub(super) decoded: usize,
    /// Predictions of F.
    pub(super) predicted: usize,
}

impl<T: Real> Passes<T> {
    /// Buffers for up to `samples` samples.
    pub(super) fn new(model: &LceModel<T>, samples: usize, per_sample: PerSample) -> Self {
        let (nets, n, a) = (&model.nets, model.sizes.latent, model.sizes.action);
        let PerSample { decoded, predicted } = per_sample;
        Self {
            encoder: EncoderPass::new(&nets.encoder, samples, 2),
            decoder_input: Block::new(decoded * n, samples),
            d_decoder_input: Block::new(decoded * n, samples),
            decoder: DecoderPass::new(&nets.decoder, samples, decoded),
            dynamics_input: Block::new(predicted * (n + a), samples),
            d_dynamics_input: Block::new(predicted * (n + a), samples),
            dynamics: DynamicsPass::new(&nets.dynamics, samples, predicted),
            passive: PassivePass::new(nets.passive_dynamics.as_ref(), samples),
            gradient: vec![T::ZERO; nets.layout.len],
        }
    }

    /// Computes what all samples of a step share; D's part only where it decodes.
    pub(super) fn pack(&mut self, model: &LceModel<T>, images: &BinaryImages, decode: bool) {
        self.encoder.pack(&model.arena, images);
        if decode {
            self.decoder.pack(&model.arena);
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> PassColumns<'_, T> {
        PassColumns {
            encoder: self.encoder.view(samples),
            decoder_input: self.decoder_input.view(samples),
            d_decoder_input: self.d_decoder_input.view(samples),
            decoder: self.decoder.view(samples),
            dynamics_input: self.dynamics_input.view(samples),
            d_dynamics_input: self.d_dynamics_input.view(samples),
            dynamics: self.dynamics.view(samples),
            passive: self.passive.view(samples),
        }
    }

    /// Sets the gradients of E, D, F and the passive dynamics over the batch whose x and x' are `pairs`. D's are zero
    /// where it does not decode.
    pub(super) fn weight_gradients(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        (images, pairs): (&BinaryImages, &[u32]),
        decode: bool,
    ) {
        let (nets, samples, gradient) = (&model.nets, pairs.len() / 2, &mut self.gradient[..]);
        self.encoder.gradient(threads, &model.arena, gradient, (images, pairs), samples);
        if decode {
            self.decoder.gradient(threads, gradient, self.decoder_input.view(samples).data, samples);
        } else {
            gradient[nets.decoder.parameters()].fill(T::ZERO);
        }
        let z_u = self.dynamics_input.view(samples).data;
        nets.dynamics.gradient(gradient, Accumulate::Replace, z_u, &self.dynamics.view(samples));
        if let Some(passive) = &nets.passive_dynamics {
            passive.gradient(gradient, &self.passive.view(samples));
        }
    }
}

impl<T: Real> PassColumns<'_, T> {
    /// -ln D(x|z) of image `image` at the `column`th decoded code. Sets the gradient with respect to its logits to
    /// `weight` times the slope.
    #[inline(always)]
    pub(super) fn reconstruction_nll(
        &mut self,
        column: usize,
        entries: usize,
        (images, image): (&BinaryImages, u32),
        weight: T,
    ) -> T {
        let range = column * entries..(column + 1) * entries;
        let (logits, deltas) = self.decoder.logits();
        heads::image(&logits[range.clone()], images, image, weight, &mut deltas[range])
    }

    /// Applies the passive dynamics to the codes of x.
    #[inline(always)]
    pub(super) fn passive_forward(&mut self, model: &LceModel<T>) {
        if let Some(passive) = &model.nets.passive_dynamics {
            let (codes, _) = self.encoder.codes();
            passive.forward(&model.arena, codes, &mut self.passive);
        }
    }

    /// Adds the gradient that reaches the codes of x through the passive dynamics.
    #[inline(always)]
    pub(super) fn passive_backward(&mut self, model: &LceModel<T>) {
        if let Some(passive) = &model.nets.passive_dynamics {
            let (codes, d_codes) = self.encoder.codes();
            passive.backward(&model.arena, codes, &mut self.passive, d_codes);
        }
    }

    /// The anchor of sample `i`. `scale` says how far one unit of action moves the code.
    #[inline(always)]
    pub(super) fn anchor<'s>(&'s mut self, i: usize, sizes: &Sizes, action: &'s [T], scale: T) -> Anchor<'s, T> {
        let codes = GaussianPair::of(self.encoder.codes(), sizes.latent, i);
        let (h, d_h) = self.passive.sample(i);
        Anchor { codes, h, d_h, action, scale, push: Push::of(sizes) }
    }
}
