//! The agent: a goal-conditioned actor, twin critics, target critics, and a temperature.

use crate::{
    nn::{
        adam::Adam,
        mlp::{Layout, Mlp, Pass},
    },
    num::{Real, rng::Rng},
};

/// Hidden layers of actor and critics (paper, Table "Hyper parameters for the SAC controller").
const HIDDEN: usize = 256;
/// Bounds of the actor's log standard deviations.
const LOG_SIGMA: (f32, f32) = (-5.0, 2.0);

/// A network and the layout of its arena. Every network of an agent has an arena and an optimiser of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Network {
    /// Names and places of the layers in the arena.
    pub layout: Layout,
    /// The layers.
    pub mlp: Mlp<3>,
}

impl Network {
    fn new(name: &str, n_in: usize, n_out: usize) -> Self {
        let mut layout = Layout::default();
        let mlp = layout.mlp(name, n_in, [HIDDEN, HIDDEN, n_out]);
        Self { layout, mlp }
    }
}

/// The networks of an agent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AgentNets {
    /// (z, z_g) -> means and log standard deviations of the action before tanh.
    pub actor: Network,
    /// (z, z_g, a) -> value.
    pub critic: Network,
}

impl AgentNets {
    /// The networks for a latent space and actions of these dimensions.
    pub fn new(latent: usize, action: usize) -> Self {
        let actor = Network::new("actor", 2 * latent, 2 * action);
        let critic = Network::new("critic", 2 * latent + action, 1);
        Self { actor, critic }
    }
}

/// Standardises codes before they enter actor and critics: subtracts the data's mean, divides by its standard
/// deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Whitening {
    /// Mean of every latent coordinate.
    pub mean: Vec<f32>,
    /// One over the standard deviation of every latent coordinate.
    pub inverse: Vec<f32>,
}

impl Whitening {
    /// The whitening of `codes`, which lie one after the other.
    pub fn of(codes: &[f32], latent: usize) -> Self {
        let count = (codes.len() / latent) as f64;
        let moment = |i: usize, f: &dyn Fn(f64) -> f64| {
            codes.iter().skip(i).step_by(latent).map(|&z| f(f64::from(z))).sum::<f64>() / count
        };
        let mean: Vec<f64> = (0..latent).map(|i| moment(i, &|z| z)).collect();
        let variance = (0..latent).map(|i| moment(i, &|z| (z - mean[i]) * (z - mean[i])));
        let inverse = variance.map(|v| (1.0 / v.sqrt().max(1e-6)) as f32).collect();
        Self { mean: mean.iter().map(|&m| m as f32).collect(), inverse }
    }

    /// Writes a whitened code.
    #[inline(always)]
    fn apply(&self, z: &[f32], out: &mut [f32]) {
        for (((out, &z), &mean), &inverse) in out.iter_mut().zip(z).zip(&self.mean).zip(&self.inverse) {
            *out = (z - mean) * inverse;
        }
    }
}

/// A network's parameters and their optimiser.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// Parameters.
    pub arena: Vec<f32>,
    /// Optimiser.
    pub adam: Adam<f32>,
}

impl Trained {
    fn new(layout: &Layout, rng: &mut Rng) -> Self {
        let arena: Vec<f32> = layout.initialize(rng);
        let adam = Adam::new(arena.len());
        Self { arena, adam }
    }
}

/// A soft actor-critic agent in the latent space. An agent keeps all of its parts over rounds, because new critics
/// would undo the policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Agent {
    /// Dimension of the latent space.
    pub latent: usize,
    /// Components of an action.
    pub action: usize,
    /// The networks.
    pub nets: AgentNets,
    /// The actor in training.
    pub actor: Trained,
    /// The averaged policy, which acts: an exponential moving average of the actor.
    pub acting: Vec<f32>,
    /// The twin critics.
    pub critics: [Trained; 2],
    /// The target critics: exponential moving averages of the critics, for bootstrapping.
    pub targets: [Vec<f32>; 2],
    /// ln alpha.
    pub log_alpha: Trained,
    /// How codes are standardised before networks read them; none where networks read codes as they are.
    pub whitening: Option<Whitening>,
}

impl Agent {
    /// An agent with random networks.
    pub fn new(latent: usize, action: usize, whitening: Option<Whitening>, log_alpha: f32, rng: &mut Rng) -> Self {
        let nets = AgentNets::new(latent, action);
        let actor = Trained::new(&nets.actor.layout, rng);
        let critics = [(); 2].map(|()| Trained::new(&nets.critic.layout, rng));
        let targets = [0, 1].map(|i: usize| critics[i].arena.clone());
        let acting = actor.arena.clone();
        let log_alpha = Trained { arena: vec![log_alpha], adam: Adam::new(1) };
        Self { latent, action, nets, actor, acting, critics, targets, log_alpha, whitening }
    }

    /// Writes whitened (z, z_g), which the networks read.
    #[inline(always)]
    pub fn input(&self, z: &[f32], z_goal: &[f32], out: &mut [f32]) {
        let (now, goal) = out.split_at_mut(self.latent);
        self.whiten(z, now);
        self.whiten(z_goal, &mut goal[..self.latent]);
    }

    /// Writes a code as the networks read it.
    #[inline(always)]
    pub(super) fn whiten(&self, z: &[f32], out: &mut [f32]) {
        match &self.whitening {
            Some(whitening) => whitening.apply(z, out),
            None => out.copy_from_slice(z),
        }
    }

    /// Adds to `d_z` the gradient that comes back through [`Agent::whiten`].
    pub(super) fn whiten_backward(&self, d_out: &[f32], d_z: &mut [f32]) {
        for (k, (d_z, &d_out)) in d_z.iter_mut().zip(d_out).enumerate() {
            *d_z += d_out * self.whitening.as_ref().map_or(1.0, |whitening| whitening.inverse[k]);
        }
    }

    /// The policy's Gaussians before tanh for whitened inputs, one column each. `arena` holds the actor's parameters.
    pub fn gaussians(&self, arena: &[f32], inputs: &[f32]) -> Vec<f32> {
        let columns = inputs.len() / (2 * self.latent);
        let net = &self.nets.actor.mlp;
        let mut pass = Pass::new(net, columns, 1);
        net.forward(arena, inputs, &mut pass.view(columns));
        let mut gaussians = pass.output().to_vec();
        for gaussian in gaussians.chunks_exact_mut(2 * self.action) {
            clamp_log_sigma(&mut gaussian[self.action..]);
        }
        gaussians
    }

    /// The averaged policy's actions in -1..1 for codes and goals, one column each. With `noise` they are samples of the
    /// policy, without it mean actions.
    pub fn act(&self, z: &[f32], z_goal: &[f32], noise: Option<&[f32]>) -> Vec<f32> {
        let (n, a) = (self.latent, self.action);
        let mut inputs = vec![0.0; 2 * z.len()];
        for ((input, z), goal) in inputs.chunks_exact_mut(2 * n).zip(z.chunks_exact(n)).zip(z_goal.chunks_exact(n)) {
            self.input(z, goal, input);
        }
        let gaussians = self.gaussians(&self.acting, &inputs);
        let mut actions = Vec::with_capacity(gaussians.len() / 2);
        for (column, gaussian) in gaussians.chunks_exact(2 * a).enumerate() {
            for i in 0..a {
                let epsilon = noise.map_or(0.0, |noise| noise[column * a + i]);
                actions.push(gaussian[a + i].e_to().mul_add(epsilon, gaussian[i]).tan_h());
            }
        }
        actions
    }

    /// alpha.
    pub fn temperature(&self) -> f32 {
        self.log_alpha.arena[0].e_to()
    }
}

/// Clamps log standard deviations to their bounds.
#[inline(always)]
pub fn clamp_log_sigma(log_sigma: &mut [f32]) {
    for l in log_sigma {
        *l = l.clamp(LOG_SIGMA.0, LOG_SIGMA.1);
    }
}

/// Whether a gradient passes through [`clamp_log_sigma`].
pub fn log_sigma_is_free(log_sigma: f32) -> bool {
    log_sigma > LOG_SIGMA.0 && log_sigma < LOG_SIGMA.1
}

/// Writes a squashed sample a = tanh(mu + sigma epsilon), and returns ln pi(a).
#[inline(always)]
pub fn squash(gaussian: &[f32], epsilon: &[f32], action: &mut [f32]) -> f32 {
    let a = epsilon.len();
    let mut log_pi = 0.0;
    for i in 0..a {
        let pre = gaussian[a + i].e_to().mul_add(epsilon[i], gaussian[i]);
        action[i] = pre.tan_h();
        // ln(1 - tanh²(p)) = 2 (ln 2 - p - softplus(-2p)). The right side suffers no cancellation.
        let x = -2.0 * pre;
        let softplus = x.max(0.0) + (-x.abs()).e_to().log_1p();
        let log_slope = 2.0 * (std::f32::consts::LN_2 - pre - softplus);
        log_pi -= 0.5 * epsilon[i] * epsilon[i] + gaussian[a + i] + 0.918_938_5 + log_slope;
    }
    log_pi
}
