//! The curvature loss L_cur: how far F's mean is from its own linearisation nearby.

use super::model::Nets;
use crate::nn::{
    Real,
    columns::{Block, BlockMut, cut_together},
    mat::Into,
    mlp::{Pass, PassMut},
};

/// Buffers: F at a point, F nearby, and the directional derivative between them.
#[derive(Debug, Clone)]
pub(super) struct Curvature<T> {
    at_input: Block<T>,
    near_input: Block<T>,
    direction: Block<T>,
    at: Pass<T, 3>,
    near: Pass<T, 3>,
    tangent: Pass<T, 3>,
}

cut_together! {
    #[derive(Debug)]
    pub(super) struct CurvatureMut<'a, T> {
        at_input: BlockMut<'a, T>,
        near_input: BlockMut<'a, T>,
        direction: BlockMut<'a, T>,
        at: PassMut<'a, T, 3>,
        near: PassMut<'a, T, 3>,
        tangent: PassMut<'a, T, 3>,
    }
}

impl<T: Real> Curvature<T> {
    pub(super) fn new(nets: &Nets, samples: usize) -> Self {
        let width = nets.dynamics.layers[0].n_in;
        let [at, near, tangent] = [(); 3].map(|()| Pass::new(&nets.dynamics, samples, 1));
        let [at_input, near_input, direction] = [(); 3].map(|()| Block::new(width, samples));
        Self { at_input, near_input, direction, at, near, tangent }
    }

    pub(super) fn view(&mut self, samples: usize) -> CurvatureMut<'_, T> {
        CurvatureMut {
            at_input: self.at_input.view(samples),
            near_input: self.near_input.view(samples),
            direction: self.direction.view(samples),
            at: self.at.view(samples),
            near: self.near.view(samples),
            tangent: self.tangent.view(samples),
        }
    }
}

impl<T: Real> CurvatureMut<'_, T> {
    /// Sets the point (z, u) of one sample and its neighbour at sigma (e_z, e_u). No gradient flows into either.
    pub(super) fn set(&mut self, sample: usize, point: [&[T]; 2], noise: [&[T]; 2], sigma: T) {
        let at = self.at_input.of(sample).iter_mut().zip(self.near_input.of(sample)).zip(self.direction.of(sample));
        let points = point.into_iter().flatten().zip(noise.into_iter().flatten());
        for (((at, near), direction), (&point, &noise)) in at.zip(points) {
            let way = sigma * noise;
            (*at, *near, *direction) = (point, point + way, way);
        }
    }

    /// |f(z + e_z, u + e_u) - f(z, u) - A e_z - B e_u|² for every sample; deltas are `weight` times its gradient.
    pub(super) fn run(&mut self, nets: &Nets, arena: &[T], weight: T, mut value: impl FnMut(usize, T)) {
        let f = &nets.dynamics;
        f.forward(arena, self.at_input.data, &mut self.at);
        f.forward(arena, self.near_input.data, &mut self.near);
        f.tangent(arena, &self.at, self.direction.data, &mut self.tangent);
        let width = f.layers[2].n_out;
        let columns = self.at.out[2].chunks_exact(width).zip(self.near.out[2].chunks_exact(width));
        let columns = columns.zip(self.tangent.out[2].chunks_exact(width));
        let deltas = self.at.delta[2].chunks_exact_mut(width).zip(self.near.delta[2].chunks_exact_mut(width));
        let deltas = deltas.zip(self.tangent.delta[2].chunks_exact_mut(width));
        for (sample, (((at, near), tangent), ((d_at, d_near), d_tangent))) in columns.zip(deltas).enumerate() {
            let mut sum = T::nil();
            for i in 0..width {
                // The upper half are means, the lower log standard deviations, which have no part in this.
                let rest = if i < width / 2 { near[i] - at[i] - tangent[i] } else { T::nil() };
                let slope = weight * (rest + rest);
                (d_at[i], d_near[i], d_tangent[i]) = (-slope, slope, -slope);
                sum += rest * rest;
            }
            value(sample, sum);
        }
        f.backward(arena, &mut self.near, None);
        f.backward(arena, &mut self.at, None);
        f.tangent_backward(arena, &self.at, &mut self.tangent);
    }

    /// Adds the gradients of the weights over all samples.
    pub(super) fn add_gradient(&self, nets: &Nets, gradient: &mut [T]) {
        let f = &nets.dynamics;
        f.gradient(1, gradient, Into::Add, self.at_input.data, &self.at);
        f.gradient(1, gradient, Into::Add, self.near_input.data, &self.near);
        f.add_tangent_gradient(gradient, self.direction.data, &self.tangent);
    }
}
