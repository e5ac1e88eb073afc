//! Checks of a latent map that need no true state.

use super::{dynamics::DynamicsPass, model::LceModel};
use crate::{nn::binary_images::BinaryImages, num::Real as _};

/// Above this share of images that D reconstructs better, a goal is suspect. Goals that control reached in the end had
/// ranks up to .991 in earlier rounds; one that control never reached had rank 1 in every round (planar, biased, seeds
/// 2 and 3).
const SUSPECT_RANK: f64 = 0.995;
/// Half of the interval over which the slope dF/du is measured, in units of the action's limit.
const HALF_STEP: f32 = 0.1;

/// The measurements that the checks are made on.
#[derive(Debug, Clone, PartialEq)]
pub struct MapChecks {
    /// Standard deviation of the codes over the encoder's own standard deviation, for the latent coordinate where this
    /// ratio is least. Below 1 the map has collapsed.
    pub spread: f64,
    /// |mean dF/du| / mean |dF/du| (Frobenius norms), in 0..=1. The lower it is, the more differently an action moves codes
    /// in different places.
    pub alignment: f64,
    /// For every goal image, the share of the images that D reconstructs better than the goal image, in 0..=1. Near 1 the
    /// goal's code may belong to another place, and control towards it ends elsewhere.
    pub goal_ranks: Vec<f64>,
}

/// Measures a model's map on `images` from all places, such as the first images of the data, and on goal images.
pub fn check(model: &LceModel, images: &BinaryImages, goals: &BinaryImages) -> MapChecks {
    let n = model.sizes.latent;
    let gaussians = model.encode(images);
    let codes: Vec<&[f32]> = gaussians.chunks_exact(2 * n).collect();
    let means: Vec<f32> = codes.iter().flat_map(|code| &code[..n]).copied().collect();
    let known = model.reconstruction_nll(images, &means);
    let rank = |goal| known.iter().filter(|&&nats| nats < goal).count() as f64 / known.len() as f64;
    let goal_ranks = model.reconstruction_nll(goals, &model.encode_means(goals)).into_iter().map(rank).collect();
    MapChecks { spread: spread(&codes, n), alignment: alignment(model, &codes), goal_ranks }
}

/// See [`MapChecks::spread`]. Codes are Gaussians.
fn spread(codes: &[&[f32]], n: usize) -> f64 {
    let count = codes.len() as f64;
    let mean_of = |f: &dyn Fn(&[f32]) -> f64| codes.iter().map(|code| f(code)).sum::<f64>() / count;
    let spread = (0..n).map(|i| {
        let mean = mean_of(&|code| f64::from(code[i]));
        let deviation = mean_of(&|code| (f64::from(code[i]) - mean).powi(2)).sqrt();
        deviation / mean_of(&|code| f64::from(code[n + i].e_to())).max(1e-12)
    });
    spread.fold(f64::INFINITY, f64::min)
}

/// See [`MapChecks::alignment`]. Codes are Gaussians.
fn alignment(model: &LceModel, codes: &[&[f32]]) -> f64 {
    let (n, a) = (model.sizes.latent, model.sizes.action);
    let count = codes.len() as f64;
    let mut mean = vec![0.0; n * a];
    let mut norm = 0.0;
    let mut pass = DynamicsPass::new(&model.nets.dynamics, 2 * a, 1);
    let mut inputs = vec![0.0; 2 * a * (n + a)];
    let mut out = vec![0.0; 2 * a * 2 * n];
    for code in codes {
        // Central differences around no action.
        for (column, input) in inputs.chunks_exact_mut(n + a).enumerate() {
            input.fill(0.0);
            input[..n].copy_from_slice(&code[..n]);
            input[n + column / 2] = if column % 2 == 0 { HALF_STEP } else { -HALF_STEP };
        }
        model.predict(&inputs, &mut pass, &mut out);
        let slope = |k: usize, i: usize| f64::from(out[2 * k * 2 * n + i] - out[(2 * k + 1) * 2 * n + i]) / 0.2;
        let jacobian: Vec<f64> = (0..a).flat_map(|k| (0..n).map(move |i| (k, i))).map(|(k, i)| slope(k, i)).collect();
        norm += jacobian.iter().map(|x| x * x).sum::<f64>().sqrt() / count;
        for (mean, x) in mean.iter_mut().zip(&jacobian) {
            *mean += x / count;
        }
    }
    mean.iter().map(|x| x * x).sum::<f64>().sqrt() / norm.max(1e-12)
}

impl MapChecks {
    /// The largest of the goals' ranks.
    pub fn goal_rank(&self) -> f64 {
        self.goal_ranks.iter().copied().fold(0.0, f64::max)
    }

    /// The suspect goals, by number: D reconstructs nearly every image better than theirs.
    pub fn suspect_goals(&self) -> Vec<usize> {
        (0..self.goal_ranks.len()).filter(|&goal| self.goal_ranks[goal] > SUSPECT_RANK).collect()
    }

    /// A sentence that says why a goal is suspect.
    pub fn why_suspect(&self, goal: usize) -> String {
        let percent = 100.0 * self.goal_ranks[goal];
        format!(
            "the decoder reconstructs goal image {goal} worse than {percent:.1} % of the first images: the goal's code may \
             belong to another place"
        )
    }

    /// Whether codes are not numbers, though all weights may be finite.
    pub fn is_diverged(&self) -> bool {
        self.alignment.is_nan()
    }

    /// A score by which maps are compared; a higher one is better, and -inf means that training diverged. If
    /// `least_alignment` is 0, alignment does not count.
    pub fn score(&self, least_alignment: f64) -> f64 {
        if self.is_diverged() {
            f64::NEG_INFINITY
        } else if self.spread < 1.0 {
            self.spread - 1.0
        } else if least_alignment > 0.0 {
            self.alignment
        } else {
            1.0
        }
    }

    /// A sentence that says what is wrong with the map, or none. Below `least_alignment` a map counts as folded.
    pub fn fault(&self, least_alignment: f64) -> Option<String> {
        match self.score(least_alignment) {
            f64::NEG_INFINITY => Some("training diverged: codes are not numbers any more".to_owned()),
            below if below < 0.0 => Some(format!(
                "the map has collapsed: codes spread {:.2} times as wide as the encoder's own noise",
                self.spread
            )),
            alignment if alignment < least_alignment => Some(format!(
                "the map is folded or twisted: the same action moves codes in different directions (alignment {alignment:.2}, below \
                 {least_alignment})"
            )),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{
            model::background,
            sizes::{ImageNetworks, Sizes},
        },
        nn::binary_images::PooledPatches,
        num::{rng::Rng, sampling},
    };

    fn model_and_frames(images: ImageNetworks) -> (LceModel, Vec<u8>) {
        let sizes = Sizes { pixels: 8 * 6, encoder: [9, 9], decoder: [9, 9], images, ..Sizes::planar() };
        let mut rng = Rng::seed_from_u64(3);
        let frames: Vec<u8> = (0..20 * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
        let background = background(&frames, sizes.pixels);
        (LceModel::new(sizes, background, &mut rng), frames)
    }

    #[test]
    fn the_reconstruction_nll_is_the_sum_over_pixels() {
        for images in [ImageNetworks::Dense, ImageNetworks::Patches(PooledPatches { columns: 6, side: 2 })] {
            let (model, frames) = model_and_frames(images);
            let pictures = model.pictures(&frames);
            let codes = model.encode_means(&pictures);
            let decoded = model.decode(&codes);
            for (i, nats) in model.reconstruction_nll(&pictures, &codes).into_iter().enumerate() {
                let pixels = i * 48..(i + 1) * 48;
                let of = |(&x, &p): (&u8, &f32)| if x != 0 { -f64::from(p).ln() } else { -(1.0 - f64::from(p)).ln() };
                let sum: f64 = frames[pixels.clone()].iter().zip(&decoded[pixels]).map(of).sum();
                assert!((f64::from(nats) - sum).abs() < 1e-4, "{nats}, not {sum}");
            }
        }
    }

    #[test]
    fn every_fault_has_its_sentence_and_a_lower_score_than_no_fault() {
        let map = |spread, alignment| MapChecks { spread, alignment, goal_ranks: Vec::new() };
        let maps = [map(f64::INFINITY, f64::NAN), map(0.5, 1.0), map(3.0, 0.7), map(3.0, 0.9)];
        for (map, word) in maps.iter().zip(["diverged", "collapsed", "folded"]) {
            assert!(map.fault(0.8).unwrap().contains(word));
        }
        assert_eq!(maps[3].fault(0.8), None);
        assert!(maps.windows(2).all(|pair| pair[0].score(0.8) < pair[1].score(0.8)));
        assert_eq!(maps[2].fault(0.0), None);
        assert!(maps[0].fault(0.0).is_some() && maps[1].fault(0.0).is_some());
    }

    #[test]
    fn a_goal_images_rank_is_the_share_of_images_that_are_reconstructed_better() {
        let (model, frames) = model_and_frames(ImageNetworks::Dense);
        let pictures = model.pictures(&frames);
        let mut ranks = check(&model, &pictures, &pictures).goal_ranks;
        ranks.sort_by(f64::total_cmp);
        assert!(ranks.iter().enumerate().all(|(i, &rank)| rank == i as f64 / 20.0), "{ranks:?}");
    }
}
