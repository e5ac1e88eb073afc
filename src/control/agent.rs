//! The agent: a goal-conditioned actor, twin critics with their targets, and a temperature.

use crate::{
    nn::{
        adam::Adam,
        mlp::{Layout, Mlp, Pass},
    },
    num::{Real, rng::Rng},
};

/// Hidden layers of actor and critics (paper, Table "Hyper parameters for the SAC controller").
const HIDDEN: usize = 256;
/// Log standard deviations of the actor stay within these.
const LOG_SIGMA: (f32, f32) = (-5.0, 2.0);

/// Where networks of an agent lie in their arenas. Every network has an arena and an optimiser of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AgentNets {
    /// (z, z_g) -> means and log standard deviations of the action before tanh.
    pub actor: (Layout, Mlp<3>),
    /// (z, z_g, a) -> value.
    pub critic: (Layout, Mlp<3>),
}

impl AgentNets {
    /// Lays out the networks for a latent space and actions of these dimensions.
    pub fn new(latent: usize, action: usize) -> Self {
        let mut layout = Layout::default();
        let actor = layout.mlp("actor", 2 * latent, [HIDDEN, HIDDEN, 2 * action]);
        let mut critic_layout = Layout::default();
        let critic = critic_layout.mlp("critic", 2 * latent + action, [HIDDEN, HIDDEN, 1]);
        Self { actor: (layout, actor), critic: (critic_layout, critic) }
    }
}

/// Shift and scale of codes before they enter actor and critics: the data's mean and standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Whitening {
    /// Mean of every latent coordinate.
    pub mean: Vec<f32>,
    /// One over its standard deviation.
    pub inverse: Vec<f32>,
}

impl Whitening {
    /// Of codes lying one after the other.
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

    /// None: codes enter as they are.
    pub fn identity(latent: usize) -> Self {
        Self { mean: vec![0.0; latent], inverse: vec![1.0; latent] }
    }

    /// Writes a whitened code.
    #[inline(always)]
    pub fn apply(&self, z: &[f32], out: &mut [f32]) {
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

/// A soft actor-critic agent in the latent space. All of it is kept over rounds: a fresh critic would undo the policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Agent {
    /// Dimension of the latent space.
    pub latent: usize,
    /// Components of an action.
    pub action: usize,
    /// Networks.
    pub nets: AgentNets,
    /// The policy.
    pub actor: Trained,
    /// A slow average of the actor, which acts.
    pub acting: Vec<f32>,
    /// The twin critics.
    pub critics: [Trained; 2],
    /// Slow averages of the critics, for bootstrapping.
    pub targets: [Vec<f32>; 2],
    /// ln alpha.
    pub log_alpha: Trained,
    /// Of the codes that the networks were trained on.
    pub whitening: Whitening,
}

impl Agent {
    /// A random agent.
    pub fn new(latent: usize, action: usize, whitening: Whitening, log_alpha: f32, rng: &mut Rng) -> Self {
        let nets = AgentNets::new(latent, action);
        let actor = Trained::new(&nets.actor.0, rng);
        let critics = [(); 2].map(|()| Trained::new(&nets.critic.0, rng));
        let targets = [0, 1].map(|i: usize| critics[i].arena.clone());
        let acting = actor.arena.clone();
        let log_alpha = Trained { arena: vec![log_alpha], adam: Adam::new(1) };
        Self { latent, action, nets, actor, acting, critics, targets, log_alpha, whitening }
    }

    /// Whitened (z, z_g), what the networks read.
    #[inline(always)]
    pub fn input(&self, z: &[f32], z_goal: &[f32], out: &mut [f32]) {
        let (now, goal) = out.split_at_mut(self.latent);
        self.whitening.apply(z, now);
        self.whitening.apply(z_goal, &mut goal[..self.latent]);
    }

    /// The policy's Gaussians before tanh for whitened inputs, one column each; `arena` is the actor's.
    pub fn gaussians(&self, arena: &[f32], inputs: &[f32]) -> Vec<f32> {
        let columns = inputs.len() / (2 * self.latent);
        let mut pass = Pass::new(&self.nets.actor.1, columns, 1);
        let mut pass = pass.view(columns);
        self.nets.actor.1.forward(arena, inputs, &mut pass);
        for gaussian in pass.out[2].chunks_exact_mut(2 * self.action) {
            clamp_log_sigma(&mut gaussian[self.action..]);
        }
        pass.output().to_vec()
    }

    /// Actions in -1..1 for codes and goals, one column each: the mean action, or with `noise` a sample.
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

/// Keeps log standard deviations within their bounds.
#[inline(always)]
pub fn clamp_log_sigma(log_sigma: &mut [f32]) {
    for l in log_sigma {
        *l = l.clamp(LOG_SIGMA.0, LOG_SIGMA.1);
    }
}

/// True where the clamp passes a gradient.
pub fn log_sigma_is_free(log_sigma: f32) -> bool {
    log_sigma > LOG_SIGMA.0 && log_sigma < LOG_SIGMA.1
}

/// A squashed sample a = tanh(mu + sigma epsilon); gives ln pi(a), and writes the action.
#[inline(always)]
pub fn squash(gaussian: &[f32], epsilon: &[f32], action: &mut [f32]) -> f32 {
    let a = epsilon.len();
    let mut log_pi = 0.0;
    for i in 0..a {
        let pre = gaussian[a + i].e_to().mul_add(epsilon[i], gaussian[i]);
        action[i] = pre.tan_h();
        // ln(1 - tanh²(p)) = 2 (ln 2 - p - softplus(-2p)), which does not cancel.
        let x = -2.0 * pre;
        let softplus = x.max(0.0) + (-x.abs()).e_to().log_1p();
        let log_slope = 2.0 * (std::f32::consts::LN_2 - pre - softplus);
        log_pi -= 0.5 * epsilon[i] * epsilon[i] + gaussian[a + i] + 0.918_938_5 + log_slope;
    }
    log_pi
}
