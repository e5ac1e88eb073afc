//! The backward dynamics B(z', u, x) -> z: three affine layers side by side, a joint layer with ReLU, a Gaussian head.

use super::model::Sizes;
use crate::{
    nn::{
        binary_images::{BinaryImages, OutputRows},
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear, mask},
    },
    num::Real,
};

/// Where the layers of B lie in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Backward {
    pub(super) z: Linear,
    pub(super) u: Linear,
    pub(super) x: Linear,
    pub(super) joint: Linear,
    pub(super) head: Linear,
}

/// Buffers of a pass.
#[derive(Debug, Clone)]
pub(super) struct BackwardPass<T> {
    /// Outputs of the z, u and x layers, one below the other; no ReLU.
    parts: Block<T>,
    joint: Block<T>,
    head: Block<T>,
    d_parts: Block<T>,
    d_joint: Block<T>,
    d_head: Block<T>,
}

cut_together! {
    #[derive(Debug)]
    pub(super) struct BackwardMut<'a, T> {
        parts: BlockMut<'a, T>,
        joint: BlockMut<'a, T>,
        head: BlockMut<'a, T>,
        d_parts: BlockMut<'a, T>,
        d_joint: BlockMut<'a, T>,
        d_head: BlockMut<'a, T>,
    }
}

impl<T: Real> BackwardPass<T> {
    pub(super) fn new(net: &Backward, samples: usize) -> Self {
        let [parts, joint, head] = [net.joint.n_in, net.joint.n_out, net.head.n_out];
        let room = |width| Block::new(width, samples);
        Self {
            parts: room(parts),
            joint: room(joint),
            head: room(head),
            d_parts: room(parts),
            d_joint: room(joint),
            d_head: room(head),
        }
    }

    pub(super) fn view(&mut self, samples: usize) -> BackwardMut<'_, T> {
        BackwardMut {
            parts: self.parts.view(samples),
            joint: self.joint.view(samples),
            head: self.head.view(samples),
            d_parts: self.d_parts.view(samples),
            d_joint: self.d_joint.view(samples),
            d_head: self.d_head.view(samples),
        }
    }
}

impl<T: Real> BackwardMut<'_, T> {
    /// The Gaussian over z for one sample.
    pub(super) fn gaussian(&mut self, sample: usize) -> &mut [T] {
        self.head.sample(sample)
    }

    /// The same beside the gradient with respect to it, to fill in.
    pub(super) fn gaussian_and_gradient(&mut self, sample: usize) -> (&[T], &mut [T]) {
        (self.head.sample(sample), self.d_head.sample(sample))
    }
}

impl Backward {
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let [n_z, n_u, n_x, n_joint] = sizes.backward;
        Self {
            z: layout.linear("backward.z", sizes.latent, n_z),
            u: layout.linear("backward.u", sizes.action, n_u),
            x: layout.linear("backward.x", sizes.entries(), n_x),
            joint: layout.linear("backward.joint", n_z + n_u + n_x, n_joint),
            head: layout.linear("backward.head", n_joint, 2 * sizes.latent),
        }
    }

    fn place_x(&self) -> OutputRows {
        OutputRows { stride: self.joint.n_in, offset: self.z.n_out + self.u.n_out }
    }

    /// W x_reference + b of the picture layer, once a step.
    pub(super) fn base<T: Real>(&self, arena: &[T], pictures: &BinaryImages, base: &mut [T]) {
        pictures.base(&self.x, arena, base);
    }

    /// B(·|z', u, x) for columns of z' and u and the pictures `x`.
    pub(super) fn forward<T: Real>(
        &self,
        arena: &[T],
        (z, u): (&[T], &[T]),
        (pictures, base, x): (&BinaryImages, &[T], &[u32]),
        pass: &mut BackwardMut<'_, T>,
    ) {
        let stride = self.joint.n_in;
        for ((parts, z), u) in
            pass.parts.data.chunks_exact_mut(stride).zip(z.chunks_exact(self.z.n_in)).zip(u.chunks_exact(self.u.n_in))
        {
            let (part_z, rest) = parts.split_at_mut(self.z.n_out);
            self.z.forward(arena, z, part_z, false);
            self.u.forward(arena, u, &mut rest[..self.u.n_out], false);
        }
        pictures.affine(&self.x, arena, base, x, pass.parts.data, self.place_x(), false);
        self.joint.forward(arena, pass.parts.data, pass.joint.data, true);
        self.head.forward(arena, pass.joint.data, pass.head.data, false);
    }

    /// Deltas of all layers from that of the head; adds the gradient with respect to z' to `d_z`.
    pub(super) fn backward<T: Real>(&self, arena: &[T], pass: &mut BackwardMut<'_, T>, d_z: &mut [T]) {
        self.head.backward(arena, pass.d_head.data, pass.d_joint.data);
        mask(pass.d_joint.data, pass.joint.data);
        self.joint.backward(arena, pass.d_joint.data, pass.d_parts.data);
        let w = self.z.w(arena);
        for (d_parts, d_z) in pass.d_parts.data.chunks_exact(self.joint.n_in).zip(d_z.chunks_exact_mut(self.z.n_in)) {
            for (d_z, w) in d_z.iter_mut().zip(w.chunks_exact(self.z.n_out)) {
                for (&w, &d) in w.iter().zip(d_parts) {
                    *d_z = w.fma(d, *d_z);
                }
            }
        }
    }

    /// Gradients of all weights over all samples.
    pub(super) fn gradient<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        (z, u): (&[T], &[T]),
        (pictures, x): (&BinaryImages, &[u32]),
        pass: &BackwardMut<'_, T>,
    ) {
        self.head.gradient(threads, gradient, Accumulate::Replace, pass.joint.data, pass.d_head.data);
        self.joint.gradient(threads, gradient, Accumulate::Replace, pass.parts.data, pass.d_joint.data);
        pictures.gradient(threads, &self.x, gradient, x, pass.d_parts.data, self.place_x());
        for (layer, input, offset) in [(self.z, z, 0), (self.u, u, self.z.n_out)] {
            let (dw, db) = layer.w_b_mut(gradient);
            dw.fill(T::ZERO);
            db.fill(T::ZERO);
            for (d, x) in pass.d_parts.data.chunks_exact(self.joint.n_in).zip(input.chunks_exact(layer.n_in)) {
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

#[cfg(test)]
mod tests;
