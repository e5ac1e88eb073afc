//! Signs of a useless map that need no true state.

use super::{LceModel, trainer::Data};
use crate::nn::{Real as _, mlp::Pass, pictures::Pictures};

/// What the detectors saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detectors {
    /// Standard deviation of the codes over the encoder's own, the smaller of the coordinates': below 1 the map has
    /// collapsed.
    pub spread: f64,
    /// |mean dF/du| / mean |dF/du| (Frobenius norms): below 0.8 an action moves the code differently in different
    /// places, and no controller was seen to succeed.
    pub alignment: f64,
}

/// Looks at up to 1,024 transitions.
pub fn of(model: &LceModel, data: &Data) -> Detectors {
    let (n, a) = (model.sizes.latent, model.sizes.action);
    let codes = model.encode(&data.pictures);
    let codes: Vec<&[f32]> = codes.chunks_exact(2 * n).step_by(2).take(1024).collect();
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
    Detectors { spread, alignment: mean.iter().map(|x| x * x).sum::<f64>().sqrt() / norm.max(1e-12) }
}

/// For every goal image the share of `pictures` that reads better than it: near 1 it lies where other pictures do, and
/// whoever is led to its code ends somewhere else.
pub fn goal_ranks(model: &LceModel, pictures: &Pictures, goals: &Pictures) -> Vec<f64> {
    let known = model.misreading(pictures);
    let rank = |goal| known.iter().filter(|&&nats| nats < goal).count() as f64 / known.len() as f64;
    model.misreading(goals).into_iter().map(rank).collect()
}

impl Detectors {
    /// What is wrong, a sentence each. Under an anchor of a small `scale` actions hardly show, and good maps were seen
    /// with any alignment.
    pub fn sentences(&self, scale: f64) -> Vec<String> {
        let mut sentences = Vec::new();
        if self.spread < 1.0 {
            sentences.push(format!(
                "the map has collapsed: codes spread {:.2} times as wide as the encoder's own noise",
                self.spread
            ));
        } else if self.alignment < 0.8 && scale >= 1.0 {
            sentences.push(format!(
                "the map is folded or twisted: the same action moves codes differently (alignment {:.2}, below 0.8)",
                self.alignment
            ));
        }
        sentences
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{Sizes, model::background},
        nn::{noise, pictures::Squares},
        rng::Rng,
    };

    fn model_and_frames(squares: Option<Squares>) -> (LceModel, Vec<u8>) {
        let sizes = Sizes { pixels: 8 * 6, encoder: [9, 9], decoder: [9, 9], squares, ..Sizes::planar() };
        let mut rng = Rng::seed_from_u64(3);
        let frames: Vec<u8> = (0..20 * sizes.pixels).map(|_| u8::from(noise::index(&mut rng, 3) == 0)).collect();
        let background = background(&frames, sizes.pixels);
        (LceModel::new(sizes, background, &mut rng), frames)
    }

    #[test]
    fn a_misreading_is_the_sum_over_pixels_of_what_the_decoder_says() {
        for squares in [None, Some(Squares { columns: 6, side: 2 })] {
            let (model, frames) = model_and_frames(squares);
            let pictures = model.pictures(&frames);
            let decoded = model.decode(&model.encode_means(&pictures));
            for (i, nats) in model.misreading(&pictures).into_iter().enumerate() {
                let pixels = i * 48..(i + 1) * 48;
                let of = |(&x, &p): (&u8, &f32)| if x != 0 { -f64::from(p).ln() } else { -(1.0 - f64::from(p)).ln() };
                let sum: f64 = frames[pixels.clone()].iter().zip(&decoded[pixels]).map(of).sum();
                assert!((f64::from(nats) - sum).abs() < 1e-4, "{nats}, not {sum}");
            }
        }
    }

    #[test]
    fn a_goal_image_ranks_after_the_pictures_that_read_better() {
        let (model, frames) = model_and_frames(None);
        let pictures = model.pictures(&frames);
        let mut ranks = goal_ranks(&model, &pictures, &pictures);
        ranks.sort_by(f64::total_cmp);
        assert!(ranks.iter().enumerate().all(|(i, &rank)| rank == i as f64 / 20.0), "{ranks:?}");
    }
}
