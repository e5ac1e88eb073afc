//! Integrates equations of motion: Dormand-Prince 5(4) with adaptive steps.
//!
//! The step size rule is that of scipy's `solve_ivp` with its default tolerances, which the public implementation of the
//! tasks uses. There the action is part of the solution, with derivative 0, so it counts in the norm of the error.

const RELATIVE: f64 = 1e-3;
const ABSOLUTE: f64 = 1e-6;
/// Bounds of the factor between the sizes of two steps, and the safety factor on it.
const SLOWEST: f64 = 0.2;
const FASTEST: f64 = 10.0;
const SAFETY: f64 = 0.9;

/// Butcher's tableau: a row has the weights of the earlier slopes at the point of the next slope. The last row gives the new
/// state.
const A: [&[f64]; 6] = [
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
    &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// Weights of the slopes in the error estimate: those of fifth order minus those of fourth order.
const E: [f64; 7] =
    [-71.0 / 57600.0, 0.0, 71.0 / 16695.0, -71.0 / 1920.0, 17253.0 / 339_200.0, -22.0 / 525.0, 1.0 / 40.0];

/// The state after `duration` seconds with the derivative `f`. `action` is constant meanwhile.
pub(super) fn after<const N: usize>(
    f: impl Fn(&[f64; N]) -> [f64; N],
    start: [f64; N],
    action: &[f64],
    duration: f64,
) -> [f64; N] {
    let (mut y, mut slope, mut time) = (start, f(&start), 0.0);
    let mut step = first_step(&f, &y, &slope, action, duration);
    let mut was_rejected = false;
    while time < duration {
        let end = (time + step).min(duration);
        assert!(end > time, "no step is short enough from {y:?}");
        let (next, next_slope, error) = attempt(&f, &y, &slope, action.len(), end - time);
        let factor = SAFETY * libm::pow(error, -0.2);
        if error < 1.0 {
            let factor = if error == 0.0 { FASTEST } else { factor.min(FASTEST) };
            step = (end - time) * if was_rejected { factor.min(1.0) } else { factor };
            (y, slope, time, was_rejected) = (next, next_slope, end, false);
        } else {
            step = (end - time) * factor.max(SLOWEST);
            was_rejected = true;
        }
    }
    y
}

/// One step: the new state, its slope, and the error as a multiple of the tolerance.
fn attempt<const N: usize>(
    f: &impl Fn(&[f64; N]) -> [f64; N],
    y: &[f64; N],
    slope: &[f64; N],
    held: usize,
    step: f64,
) -> ([f64; N], [f64; N], f64) {
    let mut slopes = [*slope; 7];
    let mut next = *y;
    for (i, weights) in A.iter().enumerate() {
        next = std::array::from_fn(|n| y[n] + step * dot(weights, &slopes, n));
        slopes[i + 1] = f(&next);
    }
    let scaled = (0..N).map(|n| step * dot(&E, &slopes, n) / tolerated(y[n].abs().max(next[n].abs())));
    let error = norm(scaled, N + held);
    (next, slopes[6], error)
}

/// The size of the first step (Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I", II.4).
fn first_step<const N: usize>(
    f: &impl Fn(&[f64; N]) -> [f64; N],
    y: &[f64; N],
    slope: &[f64; N],
    action: &[f64],
    duration: f64,
) -> f64 {
    let count = N + action.len();
    let of_size = |v: &[f64; N]| norm((0..N).map(|n| v[n] / tolerated(y[n].abs())), count);
    let d0 = norm(y.iter().chain(action).map(|y| y / tolerated(y.abs())), count);
    let d1 = of_size(slope);
    let h0 = if d0 < 1e-5 || d1 < 1e-5 { 1e-6 } else { 0.01 * d0 / d1 }.min(duration);
    let ahead = f(&std::array::from_fn(|n| y[n] + h0 * slope[n]));
    let d2 = of_size(&std::array::from_fn(|n| ahead[n] - slope[n])) / h0;
    let h1 = if d1 <= 1e-15 && d2 <= 1e-15 { (h0 * 1e-3).max(1e-6) } else { libm::pow(0.01 / d1.max(d2), 0.2) };
    (100.0 * h0).min(h1).min(duration)
}

fn dot<const N: usize>(weights: &[f64], slopes: &[[f64; N]; 7], n: usize) -> f64 {
    weights.iter().zip(slopes).map(|(weight, slope)| weight * slope[n]).sum()
}

fn tolerated(size: f64) -> f64 {
    ABSOLUTE + RELATIVE * size
}

fn norm(values: impl Iterator<Item = f64>, count: usize) -> f64 {
    (values.map(|v| v * v).sum::<f64>() / count as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oscillator_comes_back_after_a_turn() {
        let end = after(|&[x, v]| [v, -x], [1.0, 0.0], &[0.0], std::f64::consts::TAU);
        assert!((end[0] - 1.0).abs() < 5e-3 && end[1].abs() < 5e-3, "{end:?}");
    }

    #[test]
    fn polynomials_of_the_fifth_degree_are_exact() {
        // x = t^5, of which the slope holds the time.
        let [time, x] = after(|&[t, _]| [1.0, 5.0 * t * t * t * t], [0.0, 0.0], &[], 2.0);
        assert!((time - 2.0).abs() < 1e-12 && (x - 32.0).abs() < 1e-9, "{x}");
    }

    #[test]
    fn no_slope_and_no_time_change_nothing() {
        assert_eq!(after(|_| [0.0; 3], [1.0, -2.0, 0.0], &[1.0], 0.05), [1.0, -2.0, 0.0]);
        assert_eq!(after(|_| [1.0; 1], [1.0], &[], 0.0), [1.0]);
    }
}
