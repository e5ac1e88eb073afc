//! The passive dynamics h of the anchor E(x') ≈ E(x) + h(E(x)) + scale \[u; 0\]: how a code moves without an action.
//!
//! h depends on the code alone, so it cannot explain an action's effect. Only the anchor uses h; predictions come from F.

use crate::{
    nn::{
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear},
    },
    num::Real,
};

/// The form of the passive dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PassiveDynamics {
    /// Codes rest without an action: an action displaces the code.
    #[default]
    None,
    /// A quadratic function of z, learned with the model: velocities and gravity move the code.
    Quadratic,
}

impl PassiveDynamics {
    /// Whether codes rest without an action.
    pub fn is_none(&self) -> bool {
        *self == Self::None
    }
}

/// h(z) = b + W m(z), where m(z) are the monomials of degree one and two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Quadratic {
    layer: Linear,
}

/// Buffers for a batch. Without passive dynamics they are empty.
#[derive(Debug, Clone)]
pub(super) struct PassivePass<T> {
    monomials: Block<T>,
    d_monomials: Block<T>,
    h: Block<T>,
    d_h: Block<T>,
}

cut_together! {
    /// Some samples of a [`PassivePass`].
    #[derive(Debug)]
    pub(super) struct PassiveColumns<'a, T> {
        monomials: BlockMut<'a, T>,
        d_monomials: BlockMut<'a, T>,
        h: BlockMut<'a, T>,
        d_h: BlockMut<'a, T>,
    }
}

impl<T: Real> PassivePass<T> {
    /// Buffers for `samples` samples.
    pub(super) fn new(passive: Option<&Quadratic>, samples: usize) -> Self {
        let (n_in, n_out) = passive.map_or((0, 0), |passive| (passive.layer.n_in, passive.layer.n_out));
        let [monomials, d_monomials] = [(); 2].map(|()| Block::new(n_in, samples));
        let [h, d_h] = [(); 2].map(|()| Block::new(n_out, samples));
        Self { monomials, d_monomials, h, d_h }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> PassiveColumns<'_, T> {
        PassiveColumns {
            monomials: self.monomials.view(samples),
            d_monomials: self.d_monomials.view(samples),
            h: self.h.view(samples),
            d_h: self.d_h.view(samples),
        }
    }
}

impl<T> PassiveColumns<'_, T> {
    /// h at a sample's code, and the gradient with respect to it; both empty without passive dynamics.
    pub(super) fn sample(&mut self, sample: usize) -> (&[T], &mut [T]) {
        (self.h.sample(sample), self.d_h.sample(sample))
    }
}

impl Quadratic {
    /// Lays out the coefficients for `latent` coordinates.
    pub(super) fn new(layout: &mut Layout, latent: usize) -> Self {
        Self { layer: layout.linear("drift", latent + latent * (latent + 1) / 2, latent) }
    }

    /// Sets h to zero, which training starts from.
    pub(super) fn reset<T: Real>(&self, arena: &mut [T]) {
        arena[self.layer.at..][..self.layer.len()].fill(T::ZERO);
    }

    /// Computes h at the means of E(·|x), the first of the four parts of every sample's codes.
    #[inline(always)]
    pub(super) fn forward<T: Real>(&self, arena: &[T], codes: &[T], pass: &mut PassiveColumns<'_, T>) {
        let (n, width) = (self.layer.n_out, self.layer.n_in);
        for (codes, monomials) in codes.chunks_exact(4 * n).zip(pass.monomials.data.chunks_exact_mut(width)) {
            let z = &codes[..n];
            let (linear, quadratic) = monomials.split_at_mut(n);
            linear.copy_from_slice(z);
            let products = (0..n).flat_map(|i| (i..n).map(move |j| (i, j)));
            for (monomial, (i, j)) in quadratic.iter_mut().zip(products) {
                *monomial = z[i] * z[j];
            }
        }
        self.layer.forward(arena, pass.monomials.data, pass.h.data, false);
    }

    /// Adds the gradient that reaches the means of E(·|x) through h.
    #[inline(always)]
    pub(super) fn backward<T: Real>(
        &self,
        arena: &[T],
        codes: &[T],
        pass: &mut PassiveColumns<'_, T>,
        d_codes: &mut [T],
    ) {
        let (n, width) = (self.layer.n_out, self.layer.n_in);
        self.layer.backward(arena, pass.d_h.data, pass.d_monomials.data);
        let columns = codes.chunks_exact(4 * n).zip(d_codes.chunks_exact_mut(4 * n));
        for ((codes, d_codes), d_monomials) in columns.zip(pass.d_monomials.data.chunks_exact(width)) {
            let (z, d_z) = (&codes[..n], &mut d_codes[..n]);
            let (d_linear, d_quadratic) = d_monomials.split_at(n);
            for (d_z, &d) in d_z.iter_mut().zip(d_linear) {
                *d_z += d;
            }
            let products = (0..n).flat_map(|i| (i..n).map(move |j| (i, j)));
            for (&d, (i, j)) in d_quadratic.iter().zip(products) {
                d_z[i] += d * z[j];
                d_z[j] += d * z[i];
            }
        }
    }

    /// Sets the gradient of the coefficients.
    pub(super) fn gradient<T: Real>(&self, gradient: &mut [T], pass: &PassiveColumns<'_, T>) {
        self.layer.gradient(1, gradient, Accumulate::Replace, pass.monomials.data, pass.d_h.data);
    }
}
