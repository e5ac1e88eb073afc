//! E2C's transition (Watter et al., NIPS 2015): z' = A z + B u + o, where a network of z puts out v, r, B and o, and
//! A = I + v r' differs from the identity by rank one.

use super::DynamicsColumns;
use crate::{nn::mlp::Mlp, num::Real};

/// The standard deviation of a locally linear F. E2C's transition has no noise of its own, but who samples F or fits it
/// needs one. The refit's optimum does not depend on it.
const SIGMA: f64 = 0.1;

/// Where the layers of a locally linear F are in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LocallyLinear {
    /// z -> v, r, B by rows, o.
    pub(super) net: Mlp<3>,
    pub(super) action: usize,
}

/// A transition: one column of the network's output.
#[derive(Debug, Clone, Copy)]
pub struct Transition<'a, T> {
    /// Of A = I + v r'.
    pub v: &'a [T],
    /// Of A = I + v r'.
    pub r: &'a [T],
    /// B by rows.
    pub b: &'a [T],
    /// The offset o.
    pub o: &'a [T],
}

/// The gradient with respect to a [`Transition`].
#[derive(Debug)]
pub(in crate::lce) struct TransitionGradient<'a, T> {
    pub(in crate::lce) v: &'a mut [T],
    pub(in crate::lce) r: &'a mut [T],
    b: &'a mut [T],
    o: &'a mut [T],
}

#[inline(always)]
fn dot<T: Real>(x: &[T], y: &[T]) -> T {
    x.iter().zip(y).fold(T::ZERO, |sum, (&x, &y)| x.fma(y, sum))
}

impl<'a, T: Real> Transition<'a, T> {
    /// The transition in a column of the network's output.
    #[inline(always)]
    pub(in crate::lce) fn of(column: &'a [T], latent: usize) -> Self {
        let (v, rest) = column.split_at(latent);
        let (r, rest) = rest.split_at(latent);
        let (b, o) = rest.split_at(rest.len() - latent);
        Self { v, r, b, o }
    }

    /// Writes A z + B u + o - z.
    #[inline(always)]
    pub(in crate::lce) fn step(&self, z: &[T], u: &[T], step: &mut [T]) {
        let along = dot(self.r, z);
        for (k, step) in step.iter_mut().enumerate() {
            *step = self.v[k].fma(along, self.o[k]) + dot(&self.b[k * u.len()..][..u.len()], u);
        }
    }

    /// From the gradient `d_step` with respect to [`Transition::step`], adds the gradients with respect to the transition
    /// and to z.
    #[inline(always)]
    pub(in crate::lce) fn step_backward(
        &self,
        (z, u): (&[T], &[T]),
        d_step: &[T],
        d: &mut TransitionGradient<'_, T>,
        d_z: &mut [T],
    ) {
        let (along, d_along) = (dot(self.r, z), dot(self.v, d_step));
        for (k, &d_step) in d_step.iter().enumerate() {
            d.v[k] = d_step.fma(along, d.v[k]);
            d.r[k] = d_along.fma(z[k], d.r[k]);
            d.o[k] += d_step;
            d_z[k] = d_along.fma(self.r[k], d_z[k]);
            for (d_b, &u) in d.b[k * u.len()..][..u.len()].iter_mut().zip(u) {
                *d_b = d_step.fma(u, *d_b);
            }
        }
    }
}

impl<'a, T: Real> TransitionGradient<'a, T> {
    #[inline(always)]
    fn of(column: &'a mut [T], latent: usize) -> Self {
        let (v, rest) = column.split_at_mut(latent);
        let (r, rest) = rest.split_at_mut(latent);
        let (b, o) = rest.split_at_mut(rest.len() - latent);
        Self { v, r, b, o }
    }
}

impl LocallyLinear {
    /// How many numbers a transition has.
    pub(super) fn width(latent: usize, action: usize) -> usize {
        latent * (3 + action)
    }

    fn latent(&self) -> usize {
        self.net.layers[0].n_in
    }

    /// The transition in the first column of a forward pass.
    pub(super) fn first_transition<'c, T: Real>(&self, columns: &'c DynamicsColumns<'_, T>) -> Transition<'c, T> {
        let (n, width) = (self.latent(), Self::width(self.latent(), self.action));
        Transition::of(&columns.net.output()[..width], n)
    }

    /// See [`Dynamics::forward`](super::Dynamics::forward).
    #[inline(always)]
    pub(super) fn forward<T: Real>(&self, arena: &[T], z_u: &[T], columns: &mut DynamicsColumns<'_, T>) {
        let (n, a) = (self.latent(), self.action);
        let DynamicsColumns { net, z, gaussians, .. } = columns;
        for (z, z_u) in z.data.chunks_exact_mut(n).zip(z_u.chunks_exact(n + a)) {
            z.copy_from_slice(&z_u[..n]);
        }
        self.net.forward(arena, z.data, net);
        let log_sigma = T::of(SIGMA.ln());
        let transitions = net.output().chunks_exact(Self::width(n, a));
        let gaussians = gaussians.data.chunks_exact_mut(2 * n);
        for ((gaussian, transition), z_u) in gaussians.zip(transitions).zip(z_u.chunks_exact(n + a)) {
            let (step, log_sigmas) = gaussian.split_at_mut(n);
            Transition::of(transition, n).step(&z_u[..n], &z_u[n..], step);
            log_sigmas.fill(log_sigma);
        }
    }

    /// See [`Dynamics::backward`](super::Dynamics::backward).
    #[inline(always)]
    pub(super) fn backward<T: Real>(
        &self,
        arena: &[T],
        z_u: &[T],
        columns: &mut DynamicsColumns<'_, T>,
        d_z_u: Option<&mut [T]>,
    ) {
        self.backward_with(arena, z_u, columns, d_z_u, |_, _, _| {});
    }

    /// Like `backward`. `add` gets every column's transition, and adds to the gradient with respect to it.
    #[inline(always)]
    pub(in crate::lce) fn backward_with<T: Real>(
        &self,
        arena: &[T],
        z_u: &[T],
        columns: &mut DynamicsColumns<'_, T>,
        mut d_z_u: Option<&mut [T]>,
        mut add: impl FnMut(usize, Transition<'_, T>, &mut TransitionGradient<'_, T>),
    ) {
        let (n, a) = (self.latent(), self.action);
        let DynamicsColumns { net, d_z, d_gaussians, .. } = columns;
        let (transitions, d_transitions) = net.output_and_delta();
        let width = Self::width(n, a);
        let transitions = transitions.chunks_exact(width).zip(d_transitions.chunks_exact_mut(width));
        let steps = d_gaussians.data.chunks_exact(2 * n).zip(z_u.chunks_exact(n + a));
        for (i, ((transition, d_transition), (d_step, z_u))) in transitions.zip(steps).enumerate() {
            d_transition.fill(T::ZERO);
            let (transition, mut d) = (Transition::of(transition, n), TransitionGradient::of(d_transition, n));
            let d_z = &mut d_z.data[i * n..][..n];
            d_z.fill(T::ZERO);
            transition.step_backward(z_u.split_at(n), &d_step[..n], &mut d, d_z);
            add(i, transition, &mut d);
            if let Some(d_z_u) = &mut d_z_u {
                let (d_input, d_u) = d_z_u[i * (n + a)..][..n + a].split_at_mut(n);
                d_input.copy_from_slice(d_z);
                for (k, d_u) in d_u.iter_mut().enumerate() {
                    *d_u = (0..n).fold(T::ZERO, |sum, row| d_step[row].fma(transition.b[row * a + k], sum));
                }
            }
        }
        let Some(d_z_u) = d_z_u else { return self.net.backward(arena, net, None) };
        // z moves the transition, too.
        self.net.backward(arena, net, Some(&mut *d_z.data));
        for (d_z_u, d_z) in d_z_u.chunks_exact_mut(n + a).zip(d_z.data.chunks_exact(n)) {
            d_z_u.iter_mut().zip(d_z).for_each(|(sum, &d)| *sum += d);
        }
    }
}
