//! The fully connected decoder.

use crate::{
    nn::{
        columns::cut_together,
        mat::Accumulate,
        mlp::{Mlp, Pass, PassMut},
    },
    num::Real,
};

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(in crate::lce) struct DenseDecoderPass<T> {
    net: Mlp<3>,
    pass: Pass<T, 3>,
}

cut_together! {
    /// Some samples of a [`DenseDecoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct DenseDecoderColumns<'a, T> {
        net: &'a Mlp<3>,
        pass: PassMut<'a, T, 3>,
    }
}

impl<T: Real> DenseDecoderPass<T> {
    pub(super) fn new(net: &Mlp<3>, samples: usize, each: usize) -> Self {
        Self { net: *net, pass: Pass::new(net, samples, each) }
    }

    pub(super) fn view(&mut self, samples: usize) -> DenseDecoderColumns<'_, T> {
        DenseDecoderColumns { net: &self.net, pass: self.pass.view(samples) }
    }

    pub(super) fn gradient(&mut self, threads: usize, gradient: &mut [T], z: &[T], samples: usize) {
        self.net.gradient(threads, gradient, Accumulate::Replace, z, &self.pass.view(samples));
    }
}

impl<T: Real> DenseDecoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], z: &[T]) {
        self.net.forward(arena, z, &mut self.pass);
    }

    pub(super) fn backward(&mut self, arena: &[T], d_z: &mut [T]) {
        self.net.backward(arena, &mut self.pass, Some(d_z));
    }

    pub(super) fn logits(&mut self) -> (&mut [T], &mut [T]) {
        self.pass.output_and_delta()
    }
}
