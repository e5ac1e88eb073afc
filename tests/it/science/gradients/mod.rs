//! Gradients of layers, distributions and whole losses equal finite differences, in double precision.
//!
//! Layers and losses are checked at tiny sizes, on a random choice of parameters. A step of 1e-6 rarely crosses a kink of a
//! ReLU, and seeds are fixed, so the checks always give the same answer.

mod cases;
mod distillation;
mod e2c;
mod heads;
mod layers;
mod losses;
mod pc3;
mod rce;

use carl_pipe::num::{rng::Rng, sampling};

/// The step of central differences.
const H: f64 = 1e-6;

/// `count` uniform numbers from -1..1.
pub(super) fn random(rng: &mut Rng, count: usize) -> Vec<f64> {
    (0..count).map(|_| f64::from(sampling::uniform(rng, -1.0, 1.0))).collect()
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Asserts that `gradient` equals central differences of `value` in the entries `which`.
pub(super) fn check(what: &str, at: &[f64], gradient: &[f64], which: &[usize], mut value: impl FnMut(&[f64]) -> f64) {
    assert_eq!(at.len(), gradient.len(), "{what}");
    let largest = gradient.iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
    let mut moved = at.to_vec();
    for &i in which {
        moved[i] = at[i] + H;
        let above = value(&moved);
        moved[i] = at[i] - H;
        let below = value(&moved);
        moved[i] = at[i];
        let slope = (above - below) / (2.0 * H);
        let error = (slope - gradient[i]).abs() / largest;
        assert!(error < 1e-6, "{what}, entry {i}: the gradient says {}, differences say {slope}", gradient[i]);
    }
}

/// All indices of a slice.
pub(super) fn all(values: &[f64]) -> Vec<usize> {
    (0..values.len()).collect()
}
