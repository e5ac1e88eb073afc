//! The dynamics F: (z, u) -> Gaussian over z' - z. F is a network, or E2C's locally linear transition.

mod locally_linear;

use std::ops::Range;

use super::sizes::Sizes;
use crate::{
    nn::{
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass, PassMut},
    },
    num::Real,
};

pub(super) use locally_linear::TransitionGradient;
pub use locally_linear::{LocallyLinear, Transition};

/// Where the layers of F are in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dynamics {
    /// A network of (z, u) puts out the Gaussian.
    Network(Mlp<3>),
    /// A network of z puts out a transition that is linear in z and u.
    LocallyLinear(LocallyLinear),
}

/// Buffers of F for a batch.
#[derive(Debug, Clone)]
pub struct DynamicsPass<T> {
    net: Pass<T, 3>,
    /// The net's input, its gradient, the Gaussians and theirs, of a locally linear F. Otherwise they are empty.
    z: Block<T>,
    d_z: Block<T>,
    gaussians: Block<T>,
    d_gaussians: Block<T>,
}

cut_together! {
    /// Some samples of a [`DynamicsPass`].
    #[derive(Debug)]
    pub struct DynamicsColumns<'a, T> {
        net: PassMut<'a, T, 3>,
        z: BlockMut<'a, T>,
        d_z: BlockMut<'a, T>,
        gaussians: BlockMut<'a, T>,
        d_gaussians: BlockMut<'a, T>,
    }
}

impl Dynamics {
    /// Lays out F.
    pub(super) fn new(layout: &mut Layout, sizes: &Sizes) -> Self {
        let (n, a, [first, second]) = (sizes.latent, sizes.action, sizes.dynamics);
        if sizes.locally_linear {
            let width = LocallyLinear::width(n, a);
            Self::LocallyLinear(LocallyLinear { net: layout.mlp("dynamics", n, [first, second, width]), action: a })
        } else {
            Self::Network(layout.mlp("dynamics", n + a, [first, second, 2 * n]))
        }
    }

    /// The network whose output is F, or that of F's transition.
    pub fn net(&self) -> &Mlp<3> {
        match self {
            Self::Network(net) => net,
            Self::LocallyLinear(linear) => &linear.net,
        }
    }

    /// The network that puts out Gaussians.
    ///
    /// # Panics
    /// If F is locally linear: L_cur and its slopes are of a network.
    pub(super) fn network(&self) -> &Mlp<3> {
        match self {
            Self::Network(net) => net,
            Self::LocallyLinear(_) => panic!("a locally linear F has no curvature loss"),
        }
    }

    /// The locally linear transition.
    ///
    /// # Panics
    /// If F is a network: the losses of E2C and RCE are of a locally linear F.
    pub(super) fn locally_linear(&self) -> &LocallyLinear {
        match self {
            Self::Network(_) => panic!("this loss needs a locally linear F"),
            Self::LocallyLinear(linear) => linear,
        }
    }

    /// F in an arena that begins with F's first parameter.
    pub fn alone(self) -> Self {
        let first = self.parameters().start;
        let moved = |net: Mlp<3>| Mlp { layers: net.layers.map(|layer| Linear { at: layer.at - first, ..layer }) };
        match self {
            Self::Network(net) => Self::Network(moved(net)),
            Self::LocallyLinear(linear) => Self::LocallyLinear(LocallyLinear { net: moved(linear.net), ..linear }),
        }
    }

    /// The arena's entries that hold its parameters.
    pub fn parameters(&self) -> Range<usize> {
        let [first, .., last] = &self.net().layers;
        first.at..last.at + last.len()
    }

    /// F(·|z, u) for the columns \[z; u\]. Means are relative to z.
    #[inline(always)]
    pub fn forward<T: Real>(&self, arena: &[T], z_u: &[T], columns: &mut DynamicsColumns<'_, T>) {
        match self {
            Self::Network(net) => net.forward(arena, z_u, &mut columns.net),
            Self::LocallyLinear(linear) => linear.forward(arena, z_u, columns),
        }
    }

    /// The deltas of all layers, from the gradient with respect to the Gaussians, and the gradient with respect to the
    /// input into `d_z_u` if it is given.
    #[inline(always)]
    pub fn backward<T: Real>(
        &self,
        arena: &[T],
        z_u: &[T],
        columns: &mut DynamicsColumns<'_, T>,
        d_z_u: Option<&mut [T]>,
    ) {
        match self {
            Self::Network(net) => net.backward(arena, &mut columns.net, d_z_u),
            Self::LocallyLinear(linear) => linear.backward(arena, z_u, columns, d_z_u),
        }
    }

    /// The transition in the first column of a forward pass; `None` if F is a network.
    pub fn transition<'c, T: Real>(&self, columns: &'c DynamicsColumns<'_, T>) -> Option<Transition<'c, T>> {
        match self {
            Self::Network(_) => None,
            Self::LocallyLinear(linear) => Some(linear.first_transition(columns)),
        }
    }

    /// Sets or adds the gradients of all weights.
    pub fn gradient<T: Real>(
        &self,
        gradient: &mut [T],
        accumulate: Accumulate,
        z_u: &[T],
        columns: &DynamicsColumns<'_, T>,
    ) {
        let input = match self {
            Self::Network(_) => z_u,
            Self::LocallyLinear(_) => &*columns.z.data,
        };
        self.net().gradient(1, gradient, accumulate, input, &columns.net);
    }
}

impl<T: Real> DynamicsPass<T> {
    /// Buffers for `samples` samples, each of which has `each` columns.
    pub fn new(dynamics: &Dynamics, samples: usize, each: usize) -> Self {
        let net = dynamics.net();
        let latent = match dynamics {
            Dynamics::Network(_) => 0,
            Dynamics::LocallyLinear(_) => net.layers[0].n_in,
        };
        let block = |width| Block::new(width * each, samples);
        let (z, d_z, gaussians, d_gaussians) = (block(latent), block(latent), block(2 * latent), block(2 * latent));
        Self { net: Pass::new(net, samples, each), z, d_z, gaussians, d_gaussians }
    }

    /// The Gaussians of all columns.
    pub fn output(&self) -> &[T] {
        if self.gaussians.data.is_empty() { self.net.output() } else { &self.gaussians.data }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> DynamicsColumns<'_, T> {
        DynamicsColumns {
            net: self.net.view(samples),
            z: self.z.view(samples),
            d_z: self.d_z.view(samples),
            gaussians: self.gaussians.view(samples),
            d_gaussians: self.d_gaussians.view(samples),
        }
    }
}

impl<T: Real> DynamicsColumns<'_, T> {
    /// The Gaussians, and the gradient with respect to them.
    pub fn output_and_delta(&mut self) -> (&mut [T], &mut [T]) {
        // Only a locally linear F has Gaussians beside the network's output.
        if self.gaussians.data.is_empty() {
            self.net.output_and_delta()
        } else {
            (&mut *self.gaussians.data, &mut *self.d_gaussians.data)
        }
    }

    /// The output of the network's last hidden layer.
    pub fn last_hidden(&self) -> &[T] {
        self.net.last_hidden()
    }
}
