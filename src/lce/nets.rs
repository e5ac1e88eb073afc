//! Where the layers of all networks are in a model's arena.

use super::{
    backward::Backward,
    decoder::Decoder,
    dynamics::Dynamics,
    encoder::Encoder,
    passive_dynamics::{PassiveDynamics, Quadratic},
    sizes::Sizes,
};
use crate::nn::mlp::{Layout, Linear};

/// The networks of an LCE model: where each layer is in the arena.
#[derive(Debug, Clone, PartialEq)]
pub struct Nets {
    /// All layers by name, in arena order.
    pub layout: Layout,
    /// E: observation -> Gaussian over z.
    pub encoder: Encoder,
    /// D: z -> Bernoulli logits of an observation.
    pub decoder: Decoder,
    /// F: (z, u) -> Gaussian over z' - z.
    pub dynamics: Dynamics,
    /// B: (z', u, x) -> Gaussian over z.
    pub(super) backward: Backward,
    /// A head on F's last hidden layer for F's Jacobians at (z, u): A by rows, then B by rows (PCC, "amortized").
    pub jacobian_head: Option<Linear>,
    /// h, the passive dynamics. They are the last layer of the arena.
    pub(super) passive_dynamics: Option<Quadratic>,
}

impl Nets {
    /// Lays out the networks.
    pub fn new(sizes: &Sizes) -> Self {
        let mut layout = Layout::default();
        let (n, a) = (sizes.latent, sizes.action);
        let encoder = Encoder::new(&mut layout, sizes);
        let decoder = Decoder::new(&mut layout, sizes);
        let dynamics = Dynamics::new(&mut layout, sizes);
        let backward = Backward::new(&mut layout, sizes);
        let jacobian_head =
            sizes.jacobian_heads.then(|| layout.linear("dynamics.slopes", sizes.dynamics[1], n * (n + a)));
        let passive_dynamics = match sizes.passive_dynamics {
            PassiveDynamics::None => None,
            PassiveDynamics::Quadratic => Some(Quadratic::new(&mut layout, n)),
        };
        Self { layout, encoder, decoder, dynamics, backward, jacobian_head, passive_dynamics }
    }
}
