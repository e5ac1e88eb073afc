//! E prepared once: for closed loops, where a picture comes at a time, and for data sets.

use super::{
    encoder::{EncoderPass, EncoderWeights},
    model::{AT_ONCE, LceModel},
};
use crate::{
    nn::{binary_images::BinaryImages, heads},
    num::Real,
};

/// A model's encoder with its weights as the loops read them, and buffers.
#[derive(Debug)]
pub struct Observer<'a, T = f32> {
    model: &'a LceModel<T>,
    packed: EncoderWeights<T>,
    pass: EncoderPass<T>,
    at_once: usize,
}

impl<'a, T: Real> Observer<'a, T> {
    /// Prepares a model's encoder for `at_once` pictures at a time.
    pub fn new(model: &'a LceModel<T>, at_once: usize) -> Self {
        let encoder = &model.nets.encoder;
        let mut packed = encoder.packed_weights();
        encoder.pack(&model.arena, &model.pictures(&[]), &mut packed);
        Self { model, packed, pass: EncoderPass::new(encoder, at_once, 1), at_once }
    }

    /// E(·|x) for every picture: means, then log standard deviations, one column each.
    pub fn codes(&mut self, pictures: &BinaryImages) -> Vec<T> {
        let mut codes = Vec::with_capacity(2 * self.model.sizes.latent * pictures.len());
        let all: Vec<u32> = (0..pictures.len() as u32).collect();
        for which in all.chunks(self.at_once) {
            let mut pass = self.pass.view(which.len());
            self.model.nets.encoder.forward(&self.model.arena, &self.packed, (pictures, which), &mut pass);
            codes.extend_from_slice(pass.codes().0);
        }
        codes
    }

    /// The mean of E(·|x) for one picture of bytes.
    pub fn mean(&mut self, picture: &[u8]) -> Vec<T> {
        let mut code = self.codes(&self.model.pictures(picture));
        code.truncate(self.model.sizes.latent);
        code
    }
}

impl<T: Real> LceModel<T> {
    /// E(·|x) for every picture: means, then log standard deviations, one column each.
    pub fn encode(&self, pictures: &BinaryImages) -> Vec<T> {
        Observer::new(self, pictures.len().clamp(1, AT_ONCE)).codes(pictures)
    }

    /// Means of E(·|x) for every picture, one column each.
    pub fn encode_means(&self, pictures: &BinaryImages) -> Vec<T> {
        let codes = self.encode(pictures);
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
    fn no_pictures_have_no_codes() {
        for sizes in [Sizes::planar(), Sizes::cart_pole()] {
            let background = vec![0; sizes.pixels];
            let model: LceModel = LceModel::new(sizes, background, &mut Rng::seed_from_u64(1));
            assert!(model.encode(&model.pictures(&[])).is_empty());
        }
    }
}
