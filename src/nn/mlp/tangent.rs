//! Forward-mode derivatives: the directional derivative of a network, and the gradient through it.

use super::{Mlp, PassMut, mask};
use crate::{
    nn::mat::{self, Accumulate},
    num::Real,
};

impl<const L: usize> Mlp<L> {
    /// Computes the directional derivative of the network along `tangent`, at the columns of the forward pass `at`.
    pub fn tangent<T: Real>(&self, arena: &[T], at: &PassMut<'_, T, L>, tangent: &[T], pass: &mut PassMut<'_, T, L>) {
        for i in 0..L {
            let (before, after) = pass.out.split_at_mut(i);
            let x = if i == 0 { tangent } else { &*before[i - 1] };
            let (layer, columns) = (self.layers[i], after[0].len() / self.layers[i].n_out);
            mat::product(after[0], Accumulate::Replace, layer.w(arena), x, (layer.n_out, layer.n_in, columns));
            if i + 1 < L {
                mask(after[0], at.out[i]);
            }
        }
    }

    /// Computes the deltas of all layers of the directional derivative from that of the last.
    pub fn tangent_backward<T: Real>(&self, arena: &[T], at: &PassMut<'_, T, L>, pass: &mut PassMut<'_, T, L>) {
        for i in (1..L).rev() {
            let (before, after) = pass.delta.split_at_mut(i);
            self.layers[i].backward(arena, after[0], before[i - 1]);
            mask(before[i - 1], at.out[i - 1]);
        }
    }

    /// Adds the gradients of the weights through the directional derivative. It does not depend on biases.
    pub fn add_tangent_gradient<T: Real>(&self, gradient: &mut [T], tangent: &[T], pass: &PassMut<'_, T, L>) {
        for i in 0..L {
            let (dw, _) = self.layers[i].w_b_mut(gradient);
            let x = if i == 0 { tangent } else { &*pass.out[i - 1] };
            self.layers[i].weight_gradient(1, dw, Accumulate::Add, x, pass.delta[i], 0);
        }
    }
}
