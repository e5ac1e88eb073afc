//! The layout of a network's parameters in one flat arena.

use super::{Linear, Mlp};
use crate::num::{Real, rng::Rng, sampling};

/// Assigns places in an arena to layers, in the order of the calls.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Layout {
    /// Length of the arena so far.
    pub len: usize,
    /// All layers with their names, in arena order.
    pub layers: Vec<(String, Linear)>,
}

impl Layout {
    /// Adds an affine layer.
    pub fn linear(&mut self, name: impl Into<String>, n_in: usize, n_out: usize) -> Linear {
        self.conv(name, n_in, n_out, n_in)
    }

    /// Adds an affine layer whose initial weights are bounded by a `fan_in` other than `n_in`.
    pub fn conv(&mut self, name: impl Into<String>, n_in: usize, n_out: usize, fan_in: usize) -> Linear {
        let linear = Linear { n_in, n_out, fan_in, at: self.len };
        self.len += linear.len();
        self.layers.push((name.into(), linear));
        linear
    }

    /// Adds a network of `L` layers named `name.0`, `name.1`, ….
    pub fn mlp<const L: usize>(&mut self, name: &str, n_in: usize, widths: [usize; L]) -> Mlp<L> {
        let mut n_in = n_in;
        Mlp {
            layers: std::array::from_fn(|i| {
                let linear = self.linear(format!("{name}.{i}"), n_in, widths[i]);
                n_in = widths[i];
                linear
            }),
        }
    }

    /// A new arena, with the weights and biases of each layer drawn from U(-1/sqrt(fan_in), 1/sqrt(fan_in)).
    pub fn initialize<T: Real>(&self, rng: &mut Rng) -> Vec<T> {
        let mut arena = vec![T::ZERO; self.len];
        for (_, linear) in &self.layers {
            let bound = (1.0 / linear.fan_in as f64).sqrt() as f32;
            for p in &mut arena[linear.at..linear.at + linear.len()] {
                *p = T::of(f64::from(sampling::uniform(rng, -bound, bound)));
            }
        }
        arena
    }
}
