//! Fully connected networks with ReLU between their layers, over one flat arena of parameters.
//!
//! A pass keeps every layer's output and the gradient with respect to it ("delta"), per sample. Forward and backward pass
//! may therefore be cut into parts of the batch. Weight gradients are computed afterwards over the whole batch, so no sum
//! depends on how the batch was cut.

mod columnwise;
mod layout;
mod linear;
mod on_images;
mod pass;
mod tangent;

pub use columnwise::{add_bias, mask, rectify, sum_columns};
pub use layout::Layout;
pub use linear::Linear;
pub use pass::{Pass, PassMut};

use super::mat::Accumulate;
use crate::num::Real;

/// A network of `L` affine layers with ReLU between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mlp<const L: usize> {
    /// The layers.
    pub layers: [Linear; L],
}

impl<const L: usize> Mlp<L> {
    /// Runs all layers on the columns `x`.
    pub fn forward<T: Real>(&self, arena: &[T], x: &[T], pass: &mut PassMut<'_, T, L>) {
        self.layers[0].forward(arena, x, pass.out[0], L > 1);
        self.forward_from_second(arena, pass);
    }

    /// Runs the layers after the first, whose output is already in the pass.
    fn forward_from_second<T: Real>(&self, arena: &[T], pass: &mut PassMut<'_, T, L>) {
        for i in 1..L {
            let (before, after) = pass.out.split_at_mut(i);
            self.layers[i].forward(arena, before[i - 1], after[0], i + 1 < L);
        }
    }

    /// Computes the deltas of all layers from that of the last, and the gradient with respect to the input into `d_x` if
    /// it is given.
    pub fn backward<T: Real>(&self, arena: &[T], pass: &mut PassMut<'_, T, L>, d_x: Option<&mut [T]>) {
        self.backward_with_second_head(arena, pass, |_| {});
        if let Some(d_x) = d_x {
            self.layers[0].backward(arena, pass.delta[0], d_x);
        }
    }

    /// Like [`Mlp::backward`], for a network whose last hidden layer is also read by a second head. `add_gradient` adds the
    /// head's gradient with respect to the hidden layer's output.
    pub fn backward_with_second_head<T: Real>(
        &self,
        arena: &[T],
        pass: &mut PassMut<'_, T, L>,
        add_gradient: impl FnOnce(&mut [T]),
    ) {
        let mut add_gradient = Some(add_gradient);
        for i in (1..L).rev() {
            let (before, after) = pass.delta.split_at_mut(i);
            self.layers[i].backward(arena, after[0], before[i - 1]);
            if let Some(add_gradient) = add_gradient.take() {
                add_gradient(before[i - 1]);
            }
            mask(before[i - 1], pass.out[i - 1]);
        }
    }

    /// Sets or adds the gradients of all weights; `x` are the columns of the input.
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        accumulate: Accumulate,
        x: &[T],
        pass: &PassMut<'_, T, L>,
    ) {
        self.layers[0].gradient(threads, gradient, accumulate, x, pass.delta[0]);
        self.gradient_from_second(threads, gradient, accumulate, pass);
    }

    /// Sets or adds the gradients of the weights after the first layer.
    fn gradient_from_second<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        accumulate: Accumulate,
        pass: &PassMut<'_, T, L>,
    ) {
        for i in 1..L {
            self.layers[i].gradient(threads, gradient, accumulate, pass.out[i - 1], pass.delta[i]);
        }
    }
}
