//! Trains a SOLAR model: the ELBO of whole trajectories, Adam for the networks and the model of costs, natural-gradient
//! steps for the global dynamics.

use super::{
    mniw::{Expected, Mniw, Natural},
    model::{FLOOR, SolarModel},
    objective::Inference,
};
use crate::{
    lce::auto_encoder::AutoEncoder,
    nn::{
        adam::{Adam, AdamSettings},
        binary_images::BinaryImages,
    },
    num::{rng::Rng, sampling},
};

/// The variance that an action counts as having.
pub const ACTION_VARIANCE: f64 = 1e-4;

/// Trajectories of equal length in the form that training reads.
#[derive(Debug, Clone)]
pub struct Data {
    /// The pictures of all trajectories, one trajectory after the other.
    pub images: BinaryImages,
    /// Actions in -1..1, m a step.
    pub actions: Vec<f64>,
    /// The observed cost of every step; none where no costs are observed.
    pub costs: Vec<f64>,
    /// Steps of a trajectory, T.
    pub steps: usize,
}

impl Data {
    /// How many trajectories there are.
    pub fn len(&self) -> usize {
        self.images.len() / self.steps
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }
}

/// How a model is trained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Adam's step size, for the networks and for the model of costs.
    pub learning_rate: f64,
    /// The largest global norm of the networks' gradient.
    pub clip: f64,
    /// rho: a natural-gradient step goes rho/N of the way to its target.
    pub dynamics_rate: f64,
}

/// The terms of a step, averaged over its trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Terms {
    /// ln p(x | z), summed over steps and pixels.
    pub log_p_image: f64,
    /// ln p(c | z), summed over steps; 0 where no costs are observed.
    pub log_p_cost: f64,
    /// KL of the latent states.
    pub kl_local: f64,
    /// KL of the dynamics, of all transitions.
    pub kl_global: f64,
    /// Mean standard deviation that the dynamics predict.
    pub predicted_std: f64,
    /// Mean standard deviation of the codes.
    pub encoder_std: f64,
    /// Norm of the networks' gradient before clipping.
    pub gradient_norm: f64,
}

impl Terms {
    /// Every term with its name, and the weight beta of the step.
    pub fn curves(&self, beta: f64) -> [(&'static str, f64); 8] {
        [
            ("log_p_image", self.log_p_image),
            ("log_p_cost", self.log_p_cost),
            ("kl_local", self.kl_local),
            ("kl_global", self.kl_global),
            ("predicted_std", self.predicted_std),
            ("encoder_std", self.encoder_std),
            ("gradient_norm", self.gradient_norm),
            ("beta", beta),
        ]
    }
}

/// What a step is made on.
struct On<'a> {
    threads: usize,
    data: &'a Data,
    /// The numbers of the trajectories.
    batch: &'a [u32],
    /// The share of each trajectory in the loss.
    share: f64,
}

/// Trains a model. It keeps its buffers, so that a step allocates nothing.
#[derive(Debug)]
pub struct SolarTrainer {
    settings: Settings,
    passes: AutoEncoder,
    /// One for every trajectory of a batch.
    inferences: Vec<Inference>,
    which: Vec<u32>,
    noise: Vec<f64>,
    d_z: Vec<f64>,
    d_cost: Vec<f64>,
    prior: Mniw,
    natural_prior: Natural,
    expected: Vec<Expected>,
    statistics: Vec<Natural>,
    is_finite: bool,
}

impl SolarTrainer {
    /// Trains models like `model` on batches of up to `batch` trajectories of `steps` steps.
    pub fn new(model: &SolarModel, settings: Settings, steps: usize, batch: usize) -> Self {
        let (d, m) = (model.networks.sizes.latent, model.networks.sizes.action);
        let prior = Mniw::prior(d, d + m);
        Self {
            settings,
            passes: AutoEncoder::new(&model.networks, steps * batch),
            inferences: (0..batch).map(|_| Inference::new(d, m, steps, FLOOR)).collect(),
            which: Vec::with_capacity(steps * batch),
            noise: vec![0.0; steps * d],
            d_z: vec![0.0; steps * d],
            d_cost: vec![0.0; model.cost.weights.len()],
            prior,
            natural_prior: prior.natural().expect("V is the identity"),
            expected: Vec::with_capacity(model.dynamics.len()),
            statistics: vec![Natural::zero(d, d + m); model.dynamics.len()],
            is_finite: true,
        }
    }

    /// The most trajectories of a batch.
    pub fn batch(&self) -> usize {
        self.inferences.len()
    }

    /// Whether the last step left finite parameters and moments.
    pub fn is_finite(&self) -> bool {
        self.is_finite
    }

    /// One step on the trajectories `batch`. All parts of the model move from the same values.
    pub fn step(
        &mut self,
        threads: usize,
        model: &mut SolarModel,
        data: &Data,
        batch: &[u32],
        beta: f64,
        rng: &mut Rng,
    ) -> Terms {
        let steps = data.steps as u32;
        self.which.clear();
        self.which.extend(batch.iter().flat_map(|&i| i * steps..(i + 1) * steps));
        let mut terms = Terms::default();
        if self.expect(model, &mut terms).is_none() {
            terms.kl_global = f64::NAN;
            return terms;
        }
        let on = On { threads, data, batch, share: 1.0 / batch.len() as f64 };
        self.infer(&on, model, rng, &mut terms);
        self.decode(&on, model, beta, &mut terms);
        self.update(&on, model, &mut terms);
        terms
    }

    /// The expected statistics of the dynamics; `None` if a matrix is not positive definite.
    fn expect(&mut self, model: &SolarModel, terms: &mut Terms) -> Option<()> {
        let share = 1.0 / model.dynamics.len() as f64;
        self.expected.clear();
        for natural in &model.dynamics {
            let q = natural.mniw()?;
            let (expected, kl) = (q.expected()?, q.kl(&self.prior)?);
            let d = self.prior.m.rows();
            let variances = q.expected_sigma();
            terms.predicted_std += share * (0..d).map(|i| variances.at(i, i).sqrt()).sum::<f64>() / d as f64;
            terms.kl_global += kl;
            self.expected.push(expected);
        }
        Some(())
    }

    /// Encodes the pictures, and draws a sample of every posterior for the decoder.
    fn infer(&mut self, on: &On<'_>, model: &SolarModel, rng: &mut Rng, terms: &mut Terms) {
        let &On { threads, data, batch, share } = on;
        let Self { passes, inferences, which, noise, expected, .. } = self;
        let (d, m) = (model.networks.sizes.latent, model.networks.sizes.action);
        passes.encode(threads, &model.networks, (&data.images, which));
        let width = data.steps * d;
        for (b, (inference, &trajectory)) in inferences.iter_mut().zip(batch).enumerate() {
            let actions = &data.actions[trajectory as usize * data.steps * m..][..data.steps * m];
            inference.chain.set_dynamics(expected);
            passes.codes(which.len(), |codes, _| _ = inference.infer(&codes[2 * b * width..][..2 * width], actions));
            terms.kl_local += share * inference.chain.kl();
            terms.encoder_std += share * inference.mean_std();
            sampling::fill_normal(rng, noise);
            let sample = inference.chain.sample(noise);
            let (latents, _) = passes.latents(which.len());
            for (latent, &z) in latents[b * width..][..width].iter_mut().zip(sample) {
                *latent = z as f32;
            }
        }
    }

    /// The likelihoods at the samples, and their gradient with respect to the codes.
    fn decode(&mut self, on: &On<'_>, model: &SolarModel, beta: f64, terms: &mut Terms) {
        let &On { threads, data, batch, share } = on;
        let Self { passes, inferences, which, d_z, d_cost, .. } = self;
        let d = model.networks.sizes.latent;
        let nll = passes.decode(threads, &model.networks, (&data.images, which), share as f32);
        terms.log_p_image = -share * nll.iter().map(|&nll| f64::from(nll)).sum::<f64>();
        d_cost.fill(0.0);
        let width = data.steps * d;
        for (b, (inference, &trajectory)) in inferences.iter_mut().zip(batch).enumerate() {
            let (latents, from_decoder) = passes.latents(which.len());
            let latents = &latents[b * width..][..width];
            d_z.iter_mut().zip(&from_decoder[b * width..][..width]).for_each(|(d, &from)| *d = f64::from(from));
            let costs = data.costs.iter().skip(trajectory as usize * data.steps).take(data.steps);
            for (t, &cost) in costs.enumerate() {
                let mut z = [0.0; super::MOST];
                z.iter_mut().zip(&latents[t * d..][..d]).for_each(|(z, &latent)| *z = f64::from(latent));
                // The gradient of the loss, -ELBO.
                let (of_z, of_cost) = ((-beta * share, &mut d_z[t * d..][..d]), (-share, &mut d_cost[..]));
                terms.log_p_cost += share * model.cost.log_likelihood(&z[..d], cost, of_z, of_cost);
            }
            passes.codes(which.len(), |codes, d_codes| {
                let range = 2 * b * width..2 * (b + 1) * width;
                inference.backward(&codes[range.clone()], d_z, beta * share, &mut d_codes[range]);
            });
        }
    }

    /// Moves all parameters.
    fn update(&mut self, on: &On<'_>, model: &mut SolarModel, terms: &mut Terms) {
        let &On { threads, data, batch, .. } = on;
        let Self { settings, passes, inferences, which, d_cost, statistics, natural_prior, .. } = self;
        let m = model.networks.sizes.action;
        let gradient = passes.backward(threads, &model.networks, (&data.images, which));
        terms.gradient_norm = norm(gradient);
        let scale = (settings.clip / terms.gradient_norm).min(1.0);
        let adam = AdamSettings { learning_rate: settings.learning_rate, weight_decay: 0.0 };
        let arena = &mut model.networks.arena;
        self.is_finite = model.adam.step_scaled(threads, adam, arena, gradient, scale as f32);
        if !data.costs.is_empty() {
            self.is_finite &= Adam::step(&mut model.cost_adam, 1, adam, &mut model.cost.weights, d_cost);
        }
        for statistics in statistics.iter_mut() {
            *statistics = Natural::zero(natural_prior.n2.rows(), natural_prior.n2.columns());
        }
        for (inference, &trajectory) in inferences.iter().zip(batch) {
            let actions = &data.actions[trajectory as usize * data.steps * m..][..data.steps * m];
            inference.chain.add_statistics(actions, 1.0, ACTION_VARIANCE, statistics);
        }
        let (all, count) = (data.len() as f64, batch.len() as f64);
        for (natural, statistics) in model.dynamics.iter_mut().zip(&*statistics) {
            *natural = natural.step(natural_prior, statistics, settings.dynamics_rate, all, count);
        }
    }
}

/// The Euclidean norm, in an order that no number of threads changes.
fn norm(gradient: &[f32]) -> f64 {
    let mut lanes = [0.0_f64; 16];
    let (chunks, rest) = gradient.as_chunks::<16>();
    crate::num::simd::vectorize(
        #[inline(always)]
        || {
            for chunk in chunks {
                for (lane, &x) in lanes.iter_mut().zip(chunk) {
                    *lane += f64::from(x) * f64::from(x);
                }
            }
        },
    );
    let rest: f64 = rest.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
    (lanes.iter().sum::<f64>() + rest).sqrt()
}
