//! The curvature loss L_cur: how far F's mean is from a linearisation nearby, |f(z + e_z, u + e_u) - f(z, u) - A e_z - B e_u|².
//!
//! A and B are F's exact slopes at (z, u), or, where a model has heads for them, what these say: PCC's amortized version.

use super::model::Nets;
use crate::{
    nn::{
        columns::{Block, BlockMut, cut_together},
        mat::{self, Accumulate},
        mlp::{Linear, Mlp, Pass, PassMut, mask},
    },
    num::Real,
};

/// Buffers: F at a point, F nearby, and the directional derivative between them or the slopes that heads give.
#[derive(Debug, Clone)]
pub(super) struct Curvature<T> {
    at_input: Block<T>,
    near_input: Block<T>,
    direction: Block<T>,
    at: Pass<T, 3>,
    near: Pass<T, 3>,
    tangent: Pass<T, 3>,
    slopes: Block<T>,
    d_slopes: Block<T>,
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
        slopes: BlockMut<'a, T>,
        d_slopes: BlockMut<'a, T>,
    }
}

impl<T: Real> Curvature<T> {
    pub(super) fn new(nets: &Nets, samples: usize) -> Self {
        let width = nets.dynamics.layers[0].n_in;
        let [at, near, tangent] = [(); 3].map(|()| Pass::new(&nets.dynamics, samples, 1));
        let [at_input, near_input, direction] = [(); 3].map(|()| Block::new(width, samples));
        let [slopes, d_slopes] = [(); 2].map(|()| Block::new(nets.slopes.map_or(0, |head| head.n_out), samples));
        Self { at_input, near_input, direction, at, near, tangent, slopes, d_slopes }
    }

    pub(super) fn view(&mut self, samples: usize) -> CurvatureMut<'_, T> {
        CurvatureMut {
            at_input: self.at_input.view(samples),
            near_input: self.near_input.view(samples),
            direction: self.direction.view(samples),
            at: self.at.view(samples),
            near: self.near.view(samples),
            tangent: self.tangent.view(samples),
            slopes: self.slopes.view(samples),
            d_slopes: self.d_slopes.view(samples),
        }
    }
}

impl<T: Real> CurvatureMut<'_, T> {
    /// Sets the point (z, u) of one sample and its neighbour at sigma (e_z, e_u). No gradient flows into either.
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

    /// L_cur of every sample; deltas are `weight` times its gradient.
    pub(super) fn run(&mut self, nets: &Nets, arena: &[T], weight: T, value: impl FnMut(usize, T)) {
        let f = &nets.dynamics;
        f.forward(arena, self.at_input.data, &mut self.at);
        f.forward(arena, self.near_input.data, &mut self.near);
        match &nets.slopes {
            None => self.with_exact_slopes(f, arena, weight, value),
            Some(head) => self.with_learned_slopes((f, head), arena, weight, value),
        }
    }

    fn with_exact_slopes(&mut self, f: &Mlp<3>, arena: &[T], weight: T, mut value: impl FnMut(usize, T)) {
        f.tangent(arena, &self.at, self.direction.data, &mut self.tangent);
        let width = f.layers[2].n_out;
        let columns = self.at.out[2].chunks_exact(width).zip(self.near.out[2].chunks_exact(width));
        let columns = columns.zip(self.tangent.out[2].chunks_exact(width));
        let deltas = self.at.delta[2].chunks_exact_mut(width).zip(self.near.delta[2].chunks_exact_mut(width));
        let deltas = deltas.zip(self.tangent.delta[2].chunks_exact_mut(width));
        for (sample, (((at, near), tangent), ((d_at, d_near), d_tangent))) in columns.zip(deltas).enumerate() {
            let mut sum = T::ZERO;
            for i in 0..width {
                // The upper half are means, the lower log standard deviations, which have no part in this.
                let rest = if i < width / 2 { near[i] - at[i] - tangent[i] } else { T::ZERO };
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

    fn with_learned_slopes(
        &mut self,
        (f, head): (&Mlp<3>, &Linear),
        arena: &[T],
        weight: T,
        mut value: impl FnMut(usize, T),
    ) {
        head.forward(arena, self.at.out[1], self.slopes.data, false);
        let (width, n) = (f.layers[2].n_out, f.layers[2].n_out / 2);
        self.at.delta[2].fill(T::ZERO);
        self.near.delta[2].fill(T::ZERO);
        for sample in 0..self.at.out[2].len() / width {
            let (at, near) = (&self.at.out[2][sample * width..], &self.near.out[2][sample * width..]);
            let (e_z, e_u) = self.direction.sample(sample).split_at(n);
            let (a, b) = self.slopes.sample(sample).split_at(n * n);
            let (d_a, d_b) = self.d_slopes.sample(sample).split_at_mut(n * n);
            let mut sum = T::ZERO;
            for i in 0..n {
                let rows = [(e_z, a, &mut *d_a), (e_u, b, &mut *d_b)];
                let rows = rows.map(|(way, s, d_s)| (way, &s[i * way.len()..], &mut d_s[i * way.len()..]));
                // F's means are relative to z, so f(z + e_z, ·) - f(z, ·) has e_z itself in it.
                let mut rest = near[i] - at[i] + e_z[i];
                for (way, slopes, _) in &rows {
                    rest = way.iter().zip(*slopes).fold(rest, |rest, (&way, &slope)| rest - slope * way);
                }
                let slope = weight * (rest + rest);
                for (way, _, d_slopes) in rows {
                    way.iter().zip(d_slopes).for_each(|(&way, d_slope)| *d_slope = -slope * way);
                }
                self.at.delta[2][sample * width + i] = -slope;
                self.near.delta[2][sample * width + i] = slope;
                sum += rest * rest;
            }
            value(sample, sum);
        }
        f.backward(arena, &mut self.near, None);
        self.back_through_head((f, head), arena);
    }

    /// Deltas of F at the point, into whose last hidden layer those of the head flow too.
    fn back_through_head(&mut self, (f, head): (&Mlp<3>, &Linear), arena: &[T]) {
        let [d_0, d_1, d_2] = self.at.delta.each_mut();
        f.layers[2].backward(arena, d_2, d_1);
        let shape = (head.n_out, head.n_in, d_1.len() / head.n_in);
        mat::product_transposed(d_1, Accumulate::Add, head.w(arena), self.d_slopes.data, shape);
        mask(d_1, self.at.out[1]);
        f.layers[1].backward(arena, d_1, d_0);
        mask(d_0, self.at.out[0]);
    }

    /// Adds the gradients of the weights over all samples; that of the head is set.
    pub(super) fn add_gradient(&self, nets: &Nets, gradient: &mut [T]) {
        let f = &nets.dynamics;
        f.gradient(1, gradient, Accumulate::Add, self.at_input.data, &self.at);
        f.gradient(1, gradient, Accumulate::Add, self.near_input.data, &self.near);
        match &nets.slopes {
            None => f.add_tangent_gradient(gradient, self.direction.data, &self.tangent),
            Some(head) => head.gradient(1, gradient, Accumulate::Replace, self.at.out[1], self.d_slopes.data),
        }
    }
}
