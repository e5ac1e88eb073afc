//! The fully connected encoder. Its first layer reads the differences of an image from the reference image.

use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::cut_together,
        mlp::{Mlp, Pass, PassMut},
    },
    num::Real,
};

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(in crate::lce) struct DenseEncoderPass<T> {
    net: Mlp<3>,
    /// W x_reference + b of the first layer.
    base: Vec<T>,
    pass: Pass<T, 3>,
}

cut_together! {
    /// Some samples of a [`DenseEncoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct DenseEncoderColumns<'a, T> {
        net: &'a Mlp<3>,
        base: &'a [T],
        pass: PassMut<'a, T, 3>,
    }
}

impl<T: Real> DenseEncoderPass<T> {
    pub(super) fn new(net: &Mlp<3>, samples: usize, each: usize) -> Self {
        Self { net: *net, base: vec![T::ZERO; net.layers[0].n_out], pass: Pass::new(net, samples, each) }
    }

    pub(super) fn pack(&mut self, arena: &[T], images: &BinaryImages) {
        images.base(&self.net.layers[0], arena, &mut self.base);
    }

    pub(super) fn view(&mut self, samples: usize) -> DenseEncoderColumns<'_, T> {
        DenseEncoderColumns { net: &self.net, base: &self.base, pass: self.pass.view(samples) }
    }

    pub(super) fn gradient(
        &mut self,
        threads: usize,
        _: &[T],
        gradient: &mut [T],
        (images, which): (&BinaryImages, &[u32]),
        samples: usize,
    ) {
        self.net.gradient_on_images(threads, gradient, (images, which), &self.pass.view(samples));
    }
}

impl<T: Real> DenseEncoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], (images, which): (&BinaryImages, &[u32])) {
        self.net.forward_on_images(arena, self.base, (images, which), &mut self.pass);
    }

    pub(super) fn backward(&mut self, arena: &[T]) {
        self.net.backward(arena, &mut self.pass, None);
    }

    pub(super) fn codes(&mut self) -> (&mut [T], &mut [T]) {
        self.pass.output_and_delta()
    }
}
