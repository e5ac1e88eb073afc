//! The curvature loss L_cur = |f(z + e_z, u + e_u) - f(z, u) - A e_z - B e_u|², where f is F's mean (paper, equation
//! "CARL-loss"; PCC, equation 8).
//!
//! A and B are F's exact Jacobians at (z, u). In a model with a head for Jacobians they are the head's (PCC, equation 9,
//! "amortized").

use super::nets::Nets;
use crate::{
    nn::{
        columns::{Block, BlockMut, cut_together},
        mat::{self, Accumulate},
        mlp::{Linear, Mlp, Pass, PassMut},
    },
    num::Real,
};

/// Buffers: F at a point, F nearby, and either the directional derivative between them or the head's Jacobians.
#[derive(Debug, Clone)]
pub(super) struct Curvature<T> {
    at_input: Block<T>,
    near_input: Block<T>,
    direction: Block<T>,
    at: Pass<T, 3>,
    near: Pass<T, 3>,
    tangent: Pass<T, 3>,
    jacobians: Block<T>,
    d_jacobians: Block<T>,
}

cut_together! {
    /// Some samples of a [`Curvature`].
    #[derive(Debug)]
    pub(super) struct CurvatureColumns<'a, T> {
        at_input: BlockMut<'a, T>,
        near_input: BlockMut<'a, T>,
        direction: BlockMut<'a, T>,
        at: PassMut<'a, T, 3>,
        near: PassMut<'a, T, 3>,
        tangent: PassMut<'a, T, 3>,
        jacobians: BlockMut<'a, T>,
        d_jacobians: BlockMut<'a, T>,
    }
}

impl<T: Real> Curvature<T> {
    /// Buffers for `samples` samples.
    pub(super) fn new(nets: &Nets, samples: usize) -> Self {
        let f = nets.dynamics.network();
        let width = f.layers[0].n_in;
        let [at, near, tangent] = [(); 3].map(|()| Pass::new(f, samples, 1));
        let [at_input, near_input, direction] = [(); 3].map(|()| Block::new(width, samples));
        let [jacobians, d_jacobians] =
            [(); 2].map(|()| Block::new(nets.jacobian_head.map_or(0, |head| head.n_out), samples));
        Self { at_input, near_input, direction, at, near, tangent, jacobians, d_jacobians }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> CurvatureColumns<'_, T> {
        CurvatureColumns {
            at_input: self.at_input.view(samples),
            near_input: self.near_input.view(samples),
            direction: self.direction.view(samples),
            at: self.at.view(samples),
            near: self.near.view(samples),
            tangent: self.tangent.view(samples),
            jacobians: self.jacobians.view(samples),
            d_jacobians: self.d_jacobians.view(samples),
        }
    }
}

impl<T: Real> CurvatureColumns<'_, T> {
    /// Sets the point (z, u) of one sample, and the point nearby at a distance of `sigma` times `noise`. No gradient flows
    /// into either point.
    pub(super) fn set(&mut self, sample: usize, point: [&[T]; 2], noise: [&[T]; 2], sigma: T) {
        let at = self
            .at_input
            .sample(sample)
            .iter_mut()
            .zip(self.near_input.sample(sample))
            .zip(self.direction.sample(sample));
        let points = point.into_iter().flatten().zip(noise.into_iter().flatten());
        for (((at, near), direction), (&point, &noise)) in at.zip(points) {
            let way = sigma * noise;
            (*at, *near, *direction) = (point, point + way, way);
        }
    }

    /// Passes L_cur of every sample to `value`. Deltas become `weight` times its gradient.
    pub(super) fn run(&mut self, nets: &Nets, arena: &[T], weight: T, value: impl FnMut(usize, T)) {
        let f = nets.dynamics.network();
        f.forward(arena, self.at_input.data, &mut self.at);
        f.forward(arena, self.near_input.data, &mut self.near);
        match &nets.jacobian_head {
            None => self.with_exact_jacobians(f, arena, weight, value),
            Some(head) => self.with_learned_jacobians((f, head), arena, weight, value),
        }
    }

    fn with_exact_jacobians(&mut self, f: &Mlp<3>, arena: &[T], weight: T, mut value: impl FnMut(usize, T)) {
        f.tangent(arena, &self.at, self.direction.data, &mut self.tangent);
        let width = f.layers[2].n_out;
        let [(at, d_at), (near, d_near), (tangent, d_tangent)] =
            [&mut self.at, &mut self.near, &mut self.tangent].map(PassMut::output_and_delta);
        let columns = at.chunks_exact(width).zip(near.chunks_exact(width)).zip(tangent.chunks_exact(width));
        let deltas = d_at.chunks_exact_mut(width).zip(d_near.chunks_exact_mut(width));
        let deltas = deltas.zip(d_tangent.chunks_exact_mut(width));
        for (sample, (((at, near), tangent), ((d_at, d_near), d_tangent))) in columns.zip(deltas).enumerate() {
            let mut sum = T::ZERO;
            for i in 0..width {
                // The lower half are log standard deviations, which L_cur does not concern.
                let residual = if i < width / 2 { near[i] - at[i] - tangent[i] } else { T::ZERO };
                let slope = weight * (residual + residual);
                (d_at[i], d_near[i], d_tangent[i]) = (-slope, slope, -slope);
                sum += residual * residual;
            }
            value(sample, sum);
        }
        f.backward(arena, &mut self.near, None);
        f.backward(arena, &mut self.at, None);
        f.tangent_backward(arena, &self.at, &mut self.tangent);
    }

    fn with_learned_jacobians(
        &mut self,
        (f, head): (&Mlp<3>, &Linear),
        arena: &[T],
        weight: T,
        mut value: impl FnMut(usize, T),
    ) {
        head.forward(arena, self.at.last_hidden(), self.jacobians.data, false);
        let (width, n) = (f.layers[2].n_out, f.layers[2].n_out / 2);
        let [(at, d_at), (near, d_near)] = [&mut self.at, &mut self.near].map(PassMut::output_and_delta);
        d_at.fill(T::ZERO);
        d_near.fill(T::ZERO);
        let columns = at.chunks_exact(width).zip(near.chunks_exact(width));
        let deltas = d_at.chunks_exact_mut(width).zip(d_near.chunks_exact_mut(width));
        for (sample, ((at, near), (d_at, d_near))) in columns.zip(deltas).enumerate() {
            let (e_z, e_u) = self.direction.sample(sample).split_at(n);
            let (a, b) = self.jacobians.sample(sample).split_at(n * n);
            let (d_a, d_b) = self.d_jacobians.sample(sample).split_at_mut(n * n);
            let mut sum = T::ZERO;
            for i in 0..n {
                let (a, b) = (&a[i * n..][..n], &b[i * e_u.len()..][..e_u.len()]);
                // F's means are relative to z, so f(z + e_z, ·) - f(z, ·) contains e_z itself.
                let residual = near[i] - at[i] + e_z[i];
                let residual = [(e_z, a), (e_u, b)].into_iter().fold(residual, |residual, (way, row)| {
                    way.iter().zip(row).fold(residual, |residual, (&way, &slope)| residual - slope * way)
                });
                let slope = weight * (residual + residual);
                let (d_a, d_b) = (&mut d_a[i * n..][..n], &mut d_b[i * e_u.len()..][..e_u.len()]);
                for (way, d_row) in [(e_z, d_a), (e_u, d_b)] {
                    way.iter().zip(d_row).for_each(|(&way, d_slope)| *d_slope = -slope * way);
                }
                (d_at[i], d_near[i]) = (-slope, slope);
                sum += residual * residual;
            }
            value(sample, sum);
        }
        f.backward(arena, &mut self.near, None);
        self.back_through_head((f, head), arena);
    }

    /// The deltas of F at the point. The head's deltas flow into F's last hidden layer, too.
    fn back_through_head(&mut self, (f, head): (&Mlp<3>, &Linear), arena: &[T]) {
        f.backward_with_second_head(arena, &mut self.at, |d_hidden| {
            let shape = (head.n_out, head.n_in, d_hidden.len() / head.n_in);
            mat::product_transposed(d_hidden, Accumulate::Add, head.w(arena), self.d_jacobians.data, shape);
        });
    }

    /// Adds F's gradients over all samples, and sets the head's.
    pub(super) fn add_gradient(&self, nets: &Nets, gradient: &mut [T]) {
        let f = nets.dynamics.network();
        f.gradient(1, gradient, Accumulate::Add, self.at_input.data, &self.at);
        f.gradient(1, gradient, Accumulate::Add, self.near_input.data, &self.near);
        match &nets.jacobian_head {
            None => f.add_tangent_gradient(gradient, self.direction.data, &self.tangent),
            Some(head) => head.gradient(1, gradient, Accumulate::Replace, self.at.last_hidden(), self.d_jacobians.data),
        }
    }
}
