//! Networks whose first layer reads binary images.

use super::{Mlp, PassMut};
use crate::{
    nn::{
        binary_images::{BinaryImages, OutputRows},
        mat::Accumulate,
    },
    num::Real,
};

/// A network reads an image as a whole, or each frame of the image by itself. An image has one column for each frame
/// that is read, in the order of the frames.
impl<const L: usize> Mlp<L> {
    /// The rows and entries of each frame of an image. The first layer reads one frame at a time.
    fn frames(&self, images: &BinaryImages) -> impl Iterator<Item = OutputRows> + use<L> {
        let layer = self.layers[0];
        let frames = images.frames(layer.n_in);
        (0..frames).map(move |frame| OutputRows {
            stride: frames * layer.n_out,
            offset: frame * layer.n_out,
            first_entry: frame * layer.n_in,
        })
    }

    /// Runs all layers on every frame of the images `which`. `base` comes from [`BinaryImages::base`] for the first layer.
    pub fn forward_on_images<T: Real>(
        &self,
        arena: &[T],
        base: &[T],
        (images, which): (&BinaryImages, &[u32]),
        pass: &mut PassMut<'_, T, L>,
    ) {
        for frame in self.frames(images) {
            images.affine(&self.layers[0], arena, base, which, pass.out[0], frame, L > 1);
        }
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
        let mut accumulate = Accumulate::Replace;
        for frame in self.frames(images) {
            images.gradient(threads, &self.layers[0], gradient, accumulate, which, pass.delta[0], frame);
            accumulate = Accumulate::Add;
        }
        self.gradient_from_second(threads, gradient, Accumulate::Replace, pass);
    }
}
