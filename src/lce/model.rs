//! An LCE model: networks, their parameters, and what can be computed with them.

use super::{
    decoder::DecoderPass, dynamics::DynamicsPass, nets::Nets, passive_dynamics::PassiveDynamics, sizes::Sizes,
};
use crate::{
    nn::{binary_images::BinaryImages, heads},
    num::{Real, rng::Rng},
};

/// Images that are encoded or decoded together.
pub(super) const AT_ONCE: usize = 128;

/// An LCE model. All parameters are in one arena.
#[derive(Debug, Clone, PartialEq)]
pub struct LceModel<T = f32> {
    /// Widths of the networks.
    pub sizes: Sizes,
    /// Where each layer is in the arena.
    pub nets: Nets,
    /// All parameters.
    pub arena: Vec<T>,
    /// An image that resembles most observations; of 0 and 1 where there are no shades. Observations are stored as their
    /// differences from it, which saves time and changes no result.
    pub background: Vec<u8>,
}

impl<T: Real> LceModel<T> {
    /// A model with random parameters.
    pub fn new(sizes: Sizes, background: Vec<u8>, rng: &mut Rng) -> Self {
        let nets = Nets::new(&sizes);
        let mut arena = nets.layout.initialize(rng);
        nets.passive_dynamics.iter().for_each(|passive| passive.reset(&mut arena));
        Self { sizes, nets, arena, background }
    }

    /// Changes the passive dynamics and keeps all other parameters. New passive dynamics start at zero.
    pub fn set_passive_dynamics(&mut self, passive_dynamics: PassiveDynamics) {
        self.sizes.passive_dynamics = passive_dynamics;
        self.nets = Nets::new(&self.sizes);
        self.arena.resize(self.nets.layout.len, T::ZERO);
    }

    /// Gives all codes the standard deviation `sigma`: that of a loss whose encoder learns none.
    pub fn set_code_sigma(&mut self, sigma: T) {
        let (layer, outputs) = self.nets.encoder.log_sigma_outputs();
        let (weights, biases) = layer.w_b_mut(&mut self.arena);
        weights.chunks_exact_mut(layer.n_out).for_each(|column| column[outputs.clone()].fill(T::ZERO));
        biases[outputs].fill(sigma.log());
    }

    /// Observations in the form that this model reads. `frames` holds them one after the other. Without shades, a non-zero
    /// byte is a lit pixel.
    pub fn pictures(&self, frames: &[u8]) -> BinaryImages {
        let patches = self.sizes.read_patches().zip(self.sizes.predicted_patches());
        let mut images = match (patches, self.sizes.shades) {
            (Some((read, predicted)), None) => BinaryImages::pooled(self.sizes.pixels, read, predicted),
            (Some((read, predicted)), Some(likelihood)) => {
                BinaryImages::pooled(self.sizes.pixels, read, predicted).with_shades(likelihood)
            }
            (None, None) => BinaryImages::new(&self.background),
            (None, Some(likelihood)) => BinaryImages::shaded(&self.background, likelihood),
        };
        images.extend(frames);
        images
    }

    /// Writes F(·|z, u) for columns \[z; u\]. F's own means are relative to z; the written means are absolute.
    pub fn predict(&self, z_u: &[T], pass: &mut DynamicsPass<T>, gaussians: &mut [T]) {
        let (n, width) = (self.sizes.latent, self.sizes.latent + self.sizes.action);
        let mut pass = pass.view(z_u.len() / width);
        self.nets.dynamics.forward(&self.arena, z_u, &mut pass);
        gaussians.copy_from_slice(pass.output_and_delta().0);
        for (gaussian, z_u) in gaussians.chunks_exact_mut(2 * n).zip(z_u.chunks_exact(width)) {
            for i in 0..n {
                gaussian[i] += z_u[i];
            }
        }
    }

    /// Means of F(·|z, u) for columns of z and of u.
    pub fn predict_mean(&self, z: &[T], u: &[T]) -> Vec<T> {
        let (n, a) = (self.sizes.latent, self.sizes.action);
        let columns = z.len() / n;
        let z_u: Vec<T> =
            z.chunks_exact(n).zip(u.chunks_exact(a)).flat_map(|(z, u)| z.iter().chain(u)).copied().collect();
        let mut pass = DynamicsPass::new(&self.nets.dynamics, columns, 1);
        let mut gaussians = vec![T::ZERO; 2 * n * columns];
        self.predict(&z_u, &mut pass, &mut gaussians);
        gaussians.chunks_exact(2 * n).flat_map(|gaussian| &gaussian[..n]).copied().collect()
    }

    /// Probabilities of the pixels for every column of z.
    pub fn decode(&self, z: &[T]) -> Vec<T> {
        let mut probabilities = Vec::with_capacity(z.len() / self.sizes.latent * self.sizes.pixels);
        let patches = self.sizes.predicted_patches();
        let entry = |pixel| patches.map_or(pixel, |patches| patches.around(pixel));
        let probability = |l: T| T::ONE / (T::ONE + (-l).e_to());
        self.for_each_logits(z, |logits| {
            probabilities.extend((0..self.sizes.pixels).map(|pixel| probability(logits[entry(pixel)])));
        });
        probabilities
    }

    /// The reconstruction NLL -ln D(x|z) of every image at its code, in nats.
    pub fn reconstruction_nll(&self, images: &BinaryImages, codes: &[T]) -> Vec<T> {
        let mut nats = Vec::with_capacity(images.len());
        let mut delta = vec![T::ZERO; self.sizes.predicted_entries()];
        self.for_each_logits(codes, |logits| {
            nats.push(heads::image(logits, images, nats.len() as u32, T::ZERO, &mut delta));
        });
        nats
    }

    fn for_each_logits(&self, z: &[T], mut each: impl FnMut(&[T])) {
        let n = self.sizes.latent;
        let mut pass = DecoderPass::new(&self.nets.decoder, (z.len() / n).min(AT_ONCE), 1);
        pass.pack(&self.arena);
        for z in z.chunks(AT_ONCE * n) {
            let mut columns = pass.view(z.len() / n);
            columns.forward(&self.arena, z);
            let (logits, _) = columns.logits();
            logits.chunks_exact(self.sizes.predicted_entries()).for_each(&mut each);
        }
    }
}

/// The background for observations of these widths.
pub fn background_of(frames: &[u8], sizes: &Sizes) -> Vec<u8> {
    match sizes.shades {
        None => background(frames, sizes.pixels),
        Some(_) => commonest_shades(frames, sizes.pixels),
    }
}

/// An observation whose pixels have the shade that most of the observations in `frames` have there.
fn commonest_shades(frames: &[u8], pixels: usize) -> Vec<u8> {
    /// Pixels that are counted together: a row of the counts stays in the cache.
    const TOGETHER: usize = 64;
    let mut commonest = vec![0; pixels];
    for (first, commonest) in (0..pixels).step_by(TOGETHER).zip(commonest.chunks_mut(TOGETHER)) {
        let mut counts = vec![[0_u32; 256]; commonest.len()];
        for frame in frames.chunks_exact(pixels) {
            let bytes = &frame[first..first + commonest.len()];
            counts.iter_mut().zip(bytes).for_each(|(counts, &byte)| counts[usize::from(byte)] += 1);
        }
        for (commonest, counts) in commonest.iter_mut().zip(counts) {
            let most = (0..=255_u8).rev().max_by_key(|&byte| counts[usize::from(byte)]);
            *commonest = most.unwrap_or_default();
        }
    }
    commonest
}

/// An observation whose pixels are lit where most of the observations in `frames` are lit.
pub fn background(frames: &[u8], pixels: usize) -> Vec<u8> {
    let mut lit = vec![0_usize; pixels];
    for frame in frames.chunks_exact(pixels) {
        for (lit, &p) in lit.iter_mut().zip(frame) {
            *lit += usize::from(p != 0);
        }
    }
    lit.into_iter().map(|lit| u8::from(2 * lit * pixels > frames.len())).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{Differences, ImageNetworks, SharedFrames},
        nn::binary_images::PooledPatches,
        num::sampling,
    };

    #[test]
    fn a_set_deviation_is_that_of_every_code_and_leaves_the_means() {
        let patches = PooledPatches { columns: 8, side: 2 };
        let differences = Differences::Scaled { scale: 2.0 };
        let frames = SharedFrames { read: patches, predicted: patches, coordinates: 1, differences };
        let convolutional = ImageNetworks::Convolutional { frames: 2, rows: 8, columns: 8 };
        for images in [ImageNetworks::Dense, convolutional, ImageNetworks::SharedFrames(frames)] {
            let sizes = Sizes { pixels: 2 * 8 * 8, images, encoder: [8, 8], decoder: [8, 8], ..Sizes::planar() };
            let mut rng = Rng::seed_from_u64(3);
            let frames: Vec<u8> = (0..6 * 128).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
            let mut model = LceModel::<f64>::new(sizes, vec![0; 128], &mut rng);
            let pictures = model.pictures(&frames);
            let before = model.encode(&pictures);
            model.set_code_sigma(0.25);
            for (code, before) in model.encode(&pictures).chunks_exact(4).zip(before.chunks_exact(4)) {
                assert_eq!((&code[..2], &code[2..]), (&before[..2], &[0.25_f64.ln(); 2][..]));
                assert_ne!(code, before);
            }
        }
    }
}
