//! The Adam optimiser with L2 regularisation, over one flat arena of parameters.

use crate::num::{Real, join, simd::vectorize};

/// Learning rate and weight decay of an optimiser.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AdamSettings {
    /// The learning rate.
    pub learning_rate: f64,
    /// The L2 coefficient. `weight_decay` times each parameter, biases included, is added to its gradient.
    pub weight_decay: f64,
}

/// The state of an optimiser: first and second moments of the gradient, with beta 0.9 and 0.999 and epsilon 1e-8 (paper,
/// "Training Hyper-Parameters").
#[derive(Debug, Clone, PartialEq)]
pub struct Adam<T> {
    /// First moments.
    pub m: Vec<T>,
    /// Second moments.
    pub v: Vec<T>,
    /// Steps taken.
    pub steps: u64,
}

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;
/// Smaller magnitudes are set to 0. Weight decay shrinks unused weights forever, and arithmetic on subnormal numbers takes
/// a hundred times as long. This is a millionth of epsilon, so it changes nothing else.
const LEAST: f64 = 1e-14;

impl<T: Real> Adam<T> {
    /// A new optimiser for `count` parameters.
    pub fn new(count: usize) -> Self {
        Self { m: vec![T::ZERO; count], v: vec![T::ZERO; count], steps: 0 }
    }

    /// Updates the parameters by one step down the `gradient`. Returns whether all parameters and second moments are
    /// finite after it; a second moment that overflows would hold its parameter still for ever.
    #[must_use = "training must stop once a parameter is not finite"]
    pub fn step(&mut self, threads: usize, settings: AdamSettings, parameters: &mut [T], gradient: &[T]) -> bool {
        self.step_scaled(threads, settings, parameters, gradient, T::ONE)
    }

    /// Like [`Adam::step`], for `scale` times the gradient.
    #[must_use = "training must stop once a parameter is not finite"]
    pub fn step_scaled(
        &mut self,
        threads: usize,
        settings: AdamSettings,
        parameters: &mut [T],
        gradient: &[T],
        scale: T,
    ) -> bool {
        self.steps += 1;
        let bias_1 = 1.0 - BETA_1.powi(self.steps.min(100_000) as i32);
        let bias_2 = 1.0 - BETA_2.powi(self.steps.min(100_000) as i32);
        let rates = Rates {
            step: T::of(settings.learning_rate / bias_1),
            unbias: T::of(1.0 / bias_2.sqrt()),
            decay: T::of(settings.weight_decay),
            scale,
        };
        split(threads, rates, parameters, gradient, &mut self.m, &mut self.v)
    }
}

/// The factors of one step, with Adam's bias corrections.
#[derive(Clone, Copy)]
struct Rates<T> {
    step: T,
    unbias: T,
    decay: T,
    /// Factor on the gradient.
    scale: T,
}

/// Updates all parameters, in as many parts as there are threads. Returns whether all are finite.
fn split<T: Real>(threads: usize, rates: Rates<T>, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T]) -> bool {
    if threads <= 1 || p.len() < 1 << 15 {
        return update(rates, p, g, m, v);
    }
    let half = p.len() / 2;
    let ((p0, p1), (m0, m1), (v0, v1)) = (p.split_at_mut(half), m.split_at_mut(half), v.split_at_mut(half));
    let (left, right) = join(
        threads,
        || split(threads / 2, rates, p0, &g[..half], m0, v0),
        || split(threads - threads / 2, rates, p1, &g[half..], m1, v1),
    );
    left && right
}

/// Updates some parameters on this thread. Returns whether all are finite, which is told while they are at hand:
/// a pass of its own would read them from memory once more.
fn update<T: Real>(rates: Rates<T>, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T]) -> bool {
    let (b1, b2) = (T::of(BETA_1), T::of(BETA_2));
    let (c1, c2, epsilon) = (T::of(1.0 - BETA_1), T::of(1.0 - BETA_2), T::of(EPSILON));
    let (least, least_squared) = (T::of(LEAST), T::of(LEAST * LEAST));
    vectorize(
        #[inline(always)]
        || {
            // Within the closure: a flag outside of it would be written at every parameter, one after the other.
            let mut is_finite = true;
            for (((p, &g), m), v) in p.iter_mut().zip(g).zip(m).zip(v) {
                let g = flush(rates.decay.fma(*p, g * rates.scale), least);
                *m = flush(b1.fma(*m, c1 * g), least);
                *v = flush(b2.fma(*v, c2 * g * g), least_squared);
                *p = flush(*p - rates.step * *m / (v.root() * rates.unbias + epsilon), least);
                // Zero times a number is NaN where the number is infinite or NaN.
                is_finite &= p.fma(T::ZERO, *v * T::ZERO) == T::ZERO;
            }
            is_finite
        },
    )
}

#[inline(always)]
fn flush<T: Real>(x: T, least: T) -> T {
    if x < least && -x < least { T::ZERO } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_moves_every_parameter_by_the_learning_rate() {
        let mut adam = Adam::<f64>::new(2);
        let mut p = [1.0, -2.0];
        assert!(adam.step(1, AdamSettings { learning_rate: 0.01, weight_decay: 0.0 }, &mut p, &[3.0, -0.2]));
        assert!((p[0] - 0.99).abs() < 1e-9 && (p[1] + 1.99).abs() < 1e-9);
    }

    #[test]
    fn threads_change_no_bit() {
        let gradient: Vec<f32> = (0..200_000).map(|i| (i as f32 * 0.37) % 1.0 - 0.5).collect();
        let settings = AdamSettings { learning_rate: 1e-3, weight_decay: 1e-3 };
        let [one, two, four] = [1, 2, 4].map(|threads| {
            let (mut adam, mut p) = (Adam::new(gradient.len()), gradient.clone());
            assert!(adam.step(threads, settings, &mut p, &gradient));
            assert!(adam.step(threads, settings, &mut p, &gradient));
            p
        });
        assert!(one == two && one == four);
    }

    #[test]
    fn a_step_tells_of_a_parameter_or_moment_that_is_not_finite_wherever_it_is() {
        let settings = |learning_rate| AdamSettings { learning_rate, weight_decay: 0.0 };
        // The square of 1e30 overflows: the parameter would stay where it is.
        let bad = [(1e-3, f32::NAN), (1e-3, f32::INFINITY), (1e-3, 1e30), (f64::MAX, 1.0)];
        for ((learning_rate, gradient), threads) in bad.into_iter().zip([1, 2].into_iter().cycle()) {
            for at in [0, 1, 39_998, 39_999] {
                let (mut adam, mut p, mut g) = (Adam::new(40_000), vec![0.5_f32; 40_000], vec![0.0; 40_000]);
                g[at] = gradient;
                assert!(!adam.step(threads, settings(learning_rate), &mut p, &g), "{gradient} at {at}");
            }
        }
    }
}
