//! Networks whose first layer reads binary images.

use super::{Mlp, PassMut};
use crate::{
    nn::{
        binary_images::{BinaryImages, OutputRows},
        mat::Accumulate,
    },
    num::Real,
};

impl<const L: usize> Mlp<L> {
    /// The rows of the first layer's output: all of them.
    fn first_rows(&self) -> OutputRows {
        OutputRows { stride: self.layers[0].n_out, offset: 0 }
    }

    /// Runs all layers on the images `which`. `base` comes from [`BinaryImages::base`] for the first layer.
    pub fn forward_on_images<T: Real>(
        &self,
        arena: &[T],
        base: &[T],
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut PassMut<'_, T, L>,
    ) {
        images.affine(&self.layers[0], arena, base, which, pass.out[0], self.first_rows(), L > 1);
        self.forward_from_second(arena, pass);
    }

    /// Sets the gradients of all weights; `which` are the images of the forward pass.
    pub fn gradient_on_images<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        pass: &PassMut<'_, T, L>,
    ) {
        images.gradient(threads, &self.layers[0], gradient, which, pass.delta[0], self.first_rows());
        self.gradient_from_second(threads, gradient, Accumulate::Replace, pass);
    }
}
