//! The backward dynamics B(z', u, x) -> Gaussian over z: three affine layers side by side, a joint layer with ReLU, and a
//! Gaussian head (paper, "Backwards dynamical model").

use super::sizes::{BackwardSizes, Sizes};
use crate::{
    nn::{
        binary_images::{BinaryImages, OutputRows},
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear, mask},
    },
    num::Real,
};

/// Where the layers of B are in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Backward {
    z: Linear,
    u: Linear,
    x: Linear,
    joint: Linear,
    head: Linear,
}

impl Backward {
    /// Lays out the backward dynamics.
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let BackwardSizes { z, u, x, joint } = sizes.backward;
        Self {
            z: layout.linear("backward.z", sizes.latent, z),
            u: layout.linear("backward.u", sizes.action, u),
            x: layout.linear("backward.x", sizes.entries(), x),
            joint: layout.linear("backward.joint", z + u + x, joint),
            head: layout.linear("backward.head", joint, 2 * sizes.latent),
        }
    }

    /// The rows of the x layer's output among the outputs of all three layers.
    fn rows_of_x(&self) -> OutputRows {
        OutputRows { stride: self.joint.n_in, offset: self.z.n_out + self.u.n_out, first_entry: 0 }
    }
}

/// Buffers of B for a batch.
#[derive(Debug, Clone)]
pub(super) struct BackwardPass<T> {
    net: Backward,
    /// W x_reference + b of the x layer.
    base: Vec<T>,
    /// Outputs of the z, u and x layers, one below the other, without ReLU.
    parts: Block<T>,
    joint: Block<T>,
    head: Block<T>,
    d_parts: Block<T>,
    d_joint: Block<T>,
    d_head: Block<T>,
}

cut_together! {
    /// Some samples of a [`BackwardPass`].
    #[derive(Debug)]
    pub(super) struct BackwardColumns<'a, T> {
        net: &'a Backward,
        base: &'a [T],
        parts: BlockMut<'a, T>,
        joint: BlockMut<'a, T>,
        head: BlockMut<'a, T>,
        d_parts: BlockMut<'a, T>,
        d_joint: BlockMut<'a, T>,
        d_head: BlockMut<'a, T>,
    }
}

impl<T: Real> BackwardPass<T> {
    /// Buffers for `samples` samples.
    pub(super) fn new(net: &Backward, samples: usize) -> Self {
        let block = |width| Block::new(width, samples);
        Self {
            net: *net,
            base: vec![T::ZERO; net.x.n_out],
            parts: block(net.joint.n_in),
            joint: block(net.joint.n_out),
            head: block(net.head.n_out),
            d_parts: block(net.joint.n_in),
            d_joint: block(net.joint.n_out),
            d_head: block(net.head.n_out),
        }
    }

    /// Computes what all samples of a step share; once a step, before [`BackwardPass::view`].
    pub(super) fn pack(&mut self, arena: &[T], images: &BinaryImages) {
        images.base(&self.net.x, arena, &mut self.base);
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> BackwardColumns<'_, T> {
        BackwardColumns {
            net: &self.net,
            base: &self.base,
            parts: self.parts.view(samples),
            joint: self.joint.view(samples),
            head: self.head.view(samples),
            d_parts: self.d_parts.view(samples),
            d_joint: self.d_joint.view(samples),
            d_head: self.d_head.view(samples),
        }
    }

    /// Sets the gradients of all weights over the first `samples` samples.
    pub(super) fn gradient(
        &mut self,
        threads: usize,
        gradient: &mut [T],
        (z, u): (&[T], &[T]),
        (images, x): (&BinaryImages, &[u32]),
        samples: usize,
    ) {
        let net = self.net;
        let BackwardColumns { parts, joint, d_parts, d_joint, d_head, .. } = self.view(samples);
        net.head.gradient(threads, gradient, Accumulate::Replace, joint.data, d_head.data);
        net.joint.gradient(threads, gradient, Accumulate::Replace, parts.data, d_joint.data);
        images.gradient(threads, &net.x, gradient, Accumulate::Replace, x, d_parts.data, net.rows_of_x());
        for (layer, input, offset) in [(net.z, z, 0), (net.u, u, net.z.n_out)] {
            let (dw, db) = layer.w_b_mut(gradient);
            dw.fill(T::ZERO);
            db.fill(T::ZERO);
            for (d, x) in d_parts.data.chunks_exact(net.joint.n_in).zip(input.chunks_exact(layer.n_in)) {
                let d = &d[offset..offset + layer.n_out];
                for (dw, &x) in dw.chunks_exact_mut(layer.n_out).zip(x) {
                    for (dw, &d) in dw.iter_mut().zip(d) {
                        *dw = d.fma(x, *dw);
                    }
                }
                for (db, &d) in db.iter_mut().zip(d) {
                    *db += d;
                }
            }
        }
    }
}

impl<T: Real> BackwardColumns<'_, T> {
    /// B(·|z', u, x) for columns of z' and u and the images `x`.
    pub(super) fn forward(&mut self, arena: &[T], (z, u): (&[T], &[T]), (images, x): (&BinaryImages, &[u32])) {
        let net = self.net;
        let parts = self.parts.data.chunks_exact_mut(net.joint.n_in);
        for ((parts, z), u) in parts.zip(z.chunks_exact(net.z.n_in)).zip(u.chunks_exact(net.u.n_in)) {
            let (part_z, rest) = parts.split_at_mut(net.z.n_out);
            net.z.forward(arena, z, part_z, false);
            net.u.forward(arena, u, &mut rest[..net.u.n_out], false);
        }
        images.affine(&net.x, arena, self.base, x, self.parts.data, net.rows_of_x(), false);
        net.joint.forward(arena, self.parts.data, self.joint.data, true);
        net.head.forward(arena, self.joint.data, self.head.data, false);
    }

    /// The deltas of all layers, from the gradient with respect to the Gaussians. Adds the gradient with respect to z'
    /// to `d_z`.
    pub(super) fn backward(&mut self, arena: &[T], d_z: &mut [T]) {
        let net = self.net;
        net.head.backward(arena, self.d_head.data, self.d_joint.data);
        mask(self.d_joint.data, self.joint.data);
        net.joint.backward(arena, self.d_joint.data, self.d_parts.data);
        let w = net.z.w(arena);
        let d_parts = self.d_parts.data.chunks_exact(net.joint.n_in);
        for (d_parts, d_z) in d_parts.zip(d_z.chunks_exact_mut(net.z.n_in)) {
            for (d_z, w) in d_z.iter_mut().zip(w.chunks_exact(net.z.n_out)) {
                for (&w, &d) in w.iter().zip(d_parts) {
                    *d_z = w.fma(d, *d_z);
                }
            }
        }
    }

    /// The Gaussian over z of one sample.
    pub(super) fn gaussian(&mut self, sample: usize) -> &[T] {
        self.head.sample(sample)
    }

    /// The Gaussian over z of one sample, and the gradient with respect to it.
    pub(super) fn gaussian_and_gradient(&mut self, sample: usize) -> (&[T], &mut [T]) {
        (self.head.sample(sample), self.d_head.sample(sample))
    }
}

#[cfg(test)]
mod tests;
