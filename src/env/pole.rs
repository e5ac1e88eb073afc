//! What the tasks with poles share: gravity, angles that wrap around, states from ranges, process noise.
//!
//! Angles are 0 where a pole stands upright.

use super::Symmetry;
use crate::num::{rng::Rng, sampling};

/// Left and right change places. The action changes its sign, because a pole that leans the other way is pushed the
/// other way.
pub(super) const MIRROR: Symmetry = Symmetry {
    name: "mirror",
    about: "left and right change places",
    apply: |seen, _| {
        seen.mirror_columns();
        seen.reverse_action();
    },
};

/// Acceleration of gravity in m/s².
pub(super) const GRAVITY: f64 = 9.81;

/// Wraps an angle into ±`reach`: an angle beyond one end enters at the other end.
pub(super) fn wrap(mut angle: f64, reach: f64) -> f64 {
    while angle > reach {
        angle -= 2.0 * reach;
    }
    while angle < -reach {
        angle += 2.0 * reach;
    }
    angle
}

/// A uniform sample of ±`reach`.
pub(super) fn within(rng: &mut Rng, reach: f64) -> f64 {
    f64::from(sampling::uniform(rng, -1.0, 1.0)) * reach
}

/// A uniform sample of low..high and its mirror image.
pub(super) fn on_either_side(rng: &mut Rng, low: f64, high: f64) -> f64 {
    let signed = within(rng, 1.0);
    (low + (high - low) * signed.abs()).copysign(signed)
}

/// Adds process noise to every entry of a state. As in the public implementation, the sum is not wrapped or clipped.
pub(super) fn disturbed(state: impl Into<Vec<f64>>, sigma: f64, rng: &mut Rng) -> Vec<f64> {
    let mut state = state.into();
    if sigma > 0.0 {
        let mut epsilon = vec![0.0; state.len()];
        sampling::fill_normal(rng, &mut epsilon);
        state.iter_mut().zip(epsilon).for_each(|(s, epsilon)| *s += sigma * epsilon);
    }
    state
}

/// Maps a value of ±`reach` to 0..1.
pub(super) fn share(value: f64, reach: f64) -> f32 {
    ((value / reach + 1.0) / 2.0).clamp(0.0, 1.0) as f32
}

/// A grid of values over ±`reach[0]` (rows) and ±`reach[1]` (columns), with their cells.
pub(super) fn grid(reach: [f64; 2], [rows, columns]: [usize; 2]) -> impl Iterator<Item = ([f64; 2], [usize; 2])> {
    let at = move |i: usize, count: usize, reach: f64| reach * (2.0 * i as f64 / (count - 1) as f64 - 1.0);
    (0..rows).flat_map(move |r| (0..columns).map(move |c| ([at(r, rows, reach[0]), at(c, columns, reach[1])], [r, c])))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;

    #[test]
    fn an_angle_that_leaves_on_one_side_enters_on_the_other() {
        assert_eq!(wrap(1.25, 1.0), -0.75);
        assert_eq!(wrap(-4.5, 1.0), -0.5);
        assert_eq!([wrap(1.0, 1.0), wrap(-1.0, 1.0)], [1.0, -1.0]);
    }

    #[test]
    fn samples_of_either_side_leave_the_middle_out() {
        let mut rng = Rng::seed_from_u64(0);
        let samples: Vec<f64> = (0..200).map(|_| on_either_side(&mut rng, 2.0, 3.0)).collect();
        assert!(samples.iter().all(|x| (2.0..=3.0).contains(&x.abs())));
        assert!(samples.iter().filter(|x| **x > 0.0).count().abs_diff(100) < 40);
    }

    #[test]
    fn a_grid_reaches_both_ends() {
        let cells: Vec<_> = grid([1.0, 2.0], [3, 2]).collect();
        assert_eq!((cells[0], cells[3]), (([-1.0, -2.0], [0, 0]), ([0.0, 2.0], [1, 1])));
        assert_eq!(cells.len(), 6);
    }
}
