//! The cross-entropy method, for controllers that know true states and dynamics.

use crate::num::{rng::Rng, sampling};

/// The effort of a search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Plans per round.
    pub plans: usize,
    /// Rounds.
    pub rounds: usize,
}

/// Share of the plans of a round, the best ones, around which the next round draws.
const ELITE: f64 = 0.1;

/// Improves a plan of numbers in -1..1, or returns it if nothing better is found. The first round draws around it with
/// standard deviation `sigma`, later rounds around the best tenth.
pub(super) fn improve(
    plan: &[f64],
    sigma: f64,
    effort: Effort,
    cost: impl Fn(&[f64]) -> f64,
    rng: &mut Rng,
) -> Vec<f64> {
    let mut best = (cost(plan), plan.to_vec());
    let (mut mean, mut spread) = (plan.to_vec(), vec![sigma; plan.len()]);
    let elite = ((effort.plans as f64 * ELITE) as usize).max(2);
    for _ in 0..effort.rounds {
        let mut tried: Vec<(f64, Vec<f64>)> = (0..effort.plans)
            .map(|_| {
                let mut candidate = vec![0.0; mean.len()];
                sampling::fill_normal(rng, &mut candidate);
                for ((c, mean), spread) in candidate.iter_mut().zip(&mean).zip(&spread) {
                    *c = (mean + spread * *c).clamp(-1.0, 1.0);
                }
                (cost(&candidate), candidate)
            })
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        tried.truncate(elite);
        if tried[0].0 < best.0 {
            best = tried[0].clone();
        }
        for i in 0..mean.len() {
            let moment = |of: &dyn Fn(f64) -> f64| tried.iter().map(|it| of(it.1[i])).sum::<f64>() / elite as f64;
            let centre = moment(&|x| x);
            mean[i] = centre;
            spread[i] = moment(&|x| (x - centre) * (x - centre)).sqrt().max(0.05 * sigma);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;

    #[test]
    fn the_lowest_point_is_found_and_never_left() {
        let goal = [0.3, -0.9, 1.0];
        let cost = |plan: &[f64]| plan.iter().zip(goal).map(|(x, goal)| (x - goal) * (x - goal)).sum::<f64>();
        let mut rng = Rng::seed_from_u64(0);
        let found = improve(&[0.0; 3], 1.0, Effort { plans: 60, rounds: 15 }, cost, &mut rng);
        assert!(cost(&found) < 0.01, "{found:?}");
        assert_eq!(improve(&goal, 1.0, Effort { plans: 60, rounds: 3 }, cost, &mut rng), goal);
    }
}
