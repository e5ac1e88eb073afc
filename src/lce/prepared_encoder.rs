//! The encoder, prepared once for many observations: for closed loops, and for data sets.

use super::{
    encoder::EncoderPass,
    model::{AT_ONCE, LceModel},
};
use crate::{
    nn::{binary_images::BinaryImages, heads},
    num::Real,
};

/// A model's encoder with packed weights and buffers.
#[derive(Debug)]
pub struct PreparedEncoder<'a, T = f32> {
    model: &'a LceModel<T>,
    pass: EncoderPass<T>,
    at_once: usize,
}

impl<'a, T: Real> PreparedEncoder<'a, T> {
    /// Prepares a model's encoder for `at_once` observations at a time.
    pub fn new(model: &'a LceModel<T>, at_once: usize) -> Self {
        let mut pass = EncoderPass::new(&model.nets.encoder, at_once, 1);
        pass.pack(&model.arena, &model.pictures(&[]));
        Self { model, pass, at_once }
    }

    /// E(·|x) for every observation: means, then log standard deviations, one column each.
    pub fn codes(&mut self, images: &BinaryImages) -> Vec<T> {
        let mut codes = Vec::with_capacity(2 * self.model.sizes.latent * images.len());
        let all: Vec<u32> = (0..images.len() as u32).collect();
        for which in all.chunks(self.at_once) {
            let mut columns = self.pass.view(which.len());
            columns.forward(&self.model.arena, (images, which));
            codes.extend_from_slice(columns.codes().0);
        }
        codes
    }

    /// The mean of E(·|x) for one observation, a byte a pixel.
    pub fn mean(&mut self, observation: &[u8]) -> Vec<T> {
        let mut code = self.codes(&self.model.pictures(observation));
        code.truncate(self.model.sizes.latent);
        code
    }
}

impl<T: Real> LceModel<T> {
    /// E(·|x) for every observation: means, then log standard deviations, one column each.
    pub fn encode(&self, images: &BinaryImages) -> Vec<T> {
        PreparedEncoder::new(self, images.len().clamp(1, AT_ONCE)).codes(images)
    }

    /// Means of E(·|x) for every observation, one column each.
    pub fn encode_means(&self, images: &BinaryImages) -> Vec<T> {
        let codes = self.encode(images);
        codes.chunks_exact(2 * self.sizes.latent).flat_map(|code| heads::halves(code).0).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use crate::{
        lce::{LceModel, Sizes},
        num::rng::Rng,
    };

    #[test]
    fn no_observations_have_no_codes() {
        for sizes in [Sizes::planar(), Sizes::cart_pole()] {
            let background = vec![0; sizes.pixels];
            let model: LceModel = LceModel::new(sizes, background, &mut Rng::seed_from_u64(1));
            assert!(model.encode(&model.pictures(&[])).is_empty());
        }
    }
}
