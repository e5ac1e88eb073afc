//! Signs of a useless map that need no true state.

use super::LceModel;
use crate::{
    nn::{binary_images::BinaryImages, mlp::Pass},
    num::Real as _,
};

/// What the detectors saw.
#[derive(Debug, Clone, PartialEq)]
pub struct Detectors {
    /// Standard deviation of the codes over the encoder's own, the smaller of the coordinates': below 1 the map has
    /// collapsed.
    pub spread: f64,
    /// |mean dF/du| / mean |dF/du| (Frobenius norms): below 0.8 an action moves the code differently in different
    /// places, and no controller was seen to succeed.
    pub alignment: f64,
    /// For every goal image the share of the pictures that reads better than it: near 1 it lies where other pictures do,
    /// and whoever is led to its code ends somewhere else.
    pub goal_ranks: Vec<f64>,
}

/// Beyond this share of pictures that read better, a goal image is doubted: goals that were reached in the end had ranks up
/// to .991 on the way, one that was not had 1 in every round (planar, biased, seeds 2 and 3).
const MISREAD: f64 = 0.995;

/// Looks at pictures from everywhere, such as the first of the data, and at goal images.
pub fn of(model: &LceModel, pictures: &BinaryImages, goals: &BinaryImages) -> Detectors {
    let (n, a) = (model.sizes.latent, model.sizes.action);
    let gaussians = model.encode(pictures);
    let codes: Vec<&[f32]> = gaussians.chunks_exact(2 * n).collect();
    let count = codes.len() as f64;
    let mean_of = |f: &dyn Fn(&[f32]) -> f64| codes.iter().map(|code| f(code)).sum::<f64>() / count;
    let spread = (0..n).map(|i| {
        let mean = mean_of(&|code| f64::from(code[i]));
        let deviation = mean_of(&|code| (f64::from(code[i]) - mean).powi(2)).sqrt();
        deviation / mean_of(&|code| f64::from(code[n + i].e_to())).max(1e-12)
    });
    let spread = spread.fold(f64::INFINITY, f64::min);
    let mut mean = vec![0.0; n * a];
    let mut norm = 0.0;
    let mut pass = Pass::new(&model.nets.dynamics, 2 * a, 1);
    let mut inputs = vec![0.0; 2 * a * (n + a)];
    let mut out = vec![0.0; 2 * a * 2 * n];
    for code in &codes {
        // Central differences over a tenth of the action's range, on both sides of no action.
        for (column, input) in inputs.chunks_exact_mut(n + a).enumerate() {
            input.fill(0.0);
            input[..n].copy_from_slice(&code[..n]);
            input[n + column / 2] = if column % 2 == 0 { 0.1 } else { -0.1 };
        }
        model.predict(&inputs, &mut pass, &mut out);
        let slope = |k: usize, i: usize| f64::from(out[2 * k * 2 * n + i] - out[(2 * k + 1) * 2 * n + i]) / 0.2;
        let jacobian: Vec<f64> = (0..a).flat_map(|k| (0..n).map(move |i| (k, i))).map(|(k, i)| slope(k, i)).collect();
        norm += jacobian.iter().map(|x| x * x).sum::<f64>().sqrt() / count;
        for (mean, x) in mean.iter_mut().zip(&jacobian) {
            *mean += x / count;
        }
    }
    let alignment = mean.iter().map(|x| x * x).sum::<f64>().sqrt() / norm.max(1e-12);
    let means: Vec<f32> = codes.iter().flat_map(|code| &code[..n]).copied().collect();
    let known = model.misreading(pictures, &means);
    let rank = |goal| known.iter().filter(|&&nats| nats < goal).count() as f64 / known.len() as f64;
    let goal_ranks = model.misreading(goals, &model.encode_means(goals)).into_iter().map(rank).collect();
    Detectors { spread, alignment, goal_ranks }
}

impl Detectors {
    /// The worst of the goals' ranks.
    pub fn goal_rank(&self) -> f64 {
        self.goal_ranks.iter().copied().fold(0.0, f64::max)
    }

    /// Goal images that read worse than nearly every picture.
    pub fn doubted_goals(&self) -> Vec<usize> {
        (0..self.goal_ranks.len()).filter(|&goal| self.goal_ranks[goal] > MISREAD).collect()
    }

    /// Why a goal image is doubted.
    pub fn doubt(&self, goal: usize) -> String {
        let percent = 100.0 * self.goal_ranks[goal];
        format!(
            "goal image {goal} reads worse than {percent:.1} % of the first pictures: its code may lie somewhere else"
        )
    }

    /// The more, the better the map; -inf where training diverged. Under an anchor of a small `scale` actions hardly
    /// show, and good maps were seen with any alignment.
    pub fn soundness(&self, scale: f64) -> f64 {
        if self.alignment.is_nan() {
            f64::NEG_INFINITY
        } else if self.spread < 1.0 {
            self.spread - 1.0
        } else if scale >= 1.0 {
            self.alignment
        } else {
            1.0
        }
    }

    /// What is wrong with the map, if anything is.
    pub fn fault(&self, scale: f64) -> Option<String> {
        match self.soundness(scale) {
            f64::NEG_INFINITY => Some("training has diverged: codes are not numbers any more".to_owned()),
            below if below < 0.0 => Some(format!(
                "the map has collapsed: codes spread {:.2} times as wide as the encoder's own noise",
                self.spread
            )),
            alignment if alignment < 0.8 => Some(format!(
                "the map is folded or twisted: the same action moves codes differently (alignment {alignment:.2}, below 0.8)"
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
        lce::{Sizes, model::background},
        nn::binary_images::PooledPatches,
        num::{rng::Rng, sampling},
    };

    fn model_and_frames(squares: Option<PooledPatches>) -> (LceModel, Vec<u8>) {
        let sizes = Sizes { pixels: 8 * 6, encoder: [9, 9], decoder: [9, 9], squares, ..Sizes::planar() };
        let mut rng = Rng::seed_from_u64(3);
        let frames: Vec<u8> = (0..20 * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
        let background = background(&frames, sizes.pixels);
        (LceModel::new(sizes, background, &mut rng), frames)
    }

    #[test]
    fn a_misreading_is_the_sum_over_pixels_of_what_the_decoder_says() {
        for squares in [None, Some(PooledPatches { columns: 6, side: 2 })] {
            let (model, frames) = model_and_frames(squares);
            let pictures = model.pictures(&frames);
            let codes = model.encode_means(&pictures);
            let decoded = model.decode(&codes);
            for (i, nats) in model.misreading(&pictures, &codes).into_iter().enumerate() {
                let pixels = i * 48..(i + 1) * 48;
                let of = |(&x, &p): (&u8, &f32)| if x != 0 { -f64::from(p).ln() } else { -(1.0 - f64::from(p)).ln() };
                let sum: f64 = frames[pixels.clone()].iter().zip(&decoded[pixels]).map(of).sum();
                assert!((f64::from(nats) - sum).abs() < 1e-4, "{nats}, not {sum}");
            }
        }
    }

    #[test]
    fn faults_are_told_apart_and_any_is_less_sound_than_none() {
        let map = |spread, alignment| Detectors { spread, alignment, goal_ranks: Vec::new() };
        let maps = [map(f64::INFINITY, f64::NAN), map(0.5, 1.0), map(3.0, 0.7), map(3.0, 0.9)];
        for (map, word) in maps.iter().zip(["diverged", "collapsed", "folded"]) {
            assert!(map.fault(2.0).unwrap().contains(word));
        }
        assert_eq!(maps[3].fault(2.0), None);
        assert!(maps.windows(2).all(|pair| pair[0].soundness(2.0) < pair[1].soundness(2.0)));
        // Under a quiet anchor actions hardly show.
        assert_eq!(maps[2].fault(0.5), None);
        assert!(maps[0].fault(0.5).is_some() && maps[1].fault(0.5).is_some());
    }

    #[test]
    fn a_goal_image_ranks_after_the_pictures_that_read_better() {
        let (model, frames) = model_and_frames(None);
        let pictures = model.pictures(&frames);
        let mut ranks = of(&model, &pictures, &pictures).goal_ranks;
        ranks.sort_by(f64::total_cmp);
        assert!(ranks.iter().enumerate().all(|(i, &rank)| rank == i as f64 / 20.0), "{ranks:?}");
    }
}
