//! Trains an LCE model on transitions: gathers batches, draws noise, asks a back end for gradients, steps Adam.

use super::{
    backend::{Cpu, TrainingBackend},
    e2c::{E2cLoss, E2cTerms, E2cWorkspace},
    model::LceModel,
    objective::{Batch, Noise, Regularizer, Terms, Weights},
    pc3::{Pc3Loss, Pc3Terms, Pc3Workspace},
    rce::{RceLoss, RceTerms, RceWorkspace},
    transition_batch::TransitionBatch,
    warm_up::{WarmUp, WarmUpBatch, WarmUpTerms},
};
use crate::{
    nn::{
        adam::{Adam, AdamSettings},
        binary_images::BinaryImages,
    },
    num::{Real, rng::Rng, sampling},
};

pub use super::backend::BATCH;

/// Transitions (x, u, x') in the form that training reads. They contain no true state.
#[derive(Debug, Clone)]
pub struct Data<T = f32> {
    /// Images 2i and 2i + 1 are x and x' of transition i. Among N transitions, copy c of transition i has the
    /// index c N + i.
    pub images: BinaryImages,
    /// Actions in -1..1, one column for every transition.
    pub actions: Vec<T>,
    /// Components of an action.
    pub action_dim: usize,
    /// How many copies of every transition `images` and `actions` hold. A training step draws one of the copies at
    /// random.
    pub copies: usize,
}

impl<T> Data<T> {
    /// How many transitions there are. All copies of a transition count as one.
    pub fn len(&self) -> usize {
        self.actions.len() / (self.action_dim * self.copies)
    }

    /// Whether there are no transitions.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// The index of a random copy of a transition.
    fn draw_copy(&self, transition: u32, rng: &mut Rng) -> u32 {
        let copy = if self.copies > 1 { sampling::index(rng, self.copies) } else { 0 };
        (copy * self.len()) as u32 + transition
    }
}

/// The loss as training uses it.
#[derive(Clone, Copy)]
pub struct Objective<'a, T> {
    /// Weights of the terms.
    pub weights: Weights,
    /// Standard deviation of the curvature loss's noise.
    pub curvature_sigma: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
    /// Value-guided weights, one for every transition of the data.
    pub guidance: Option<&'a [T]>,
    /// L_reg, by the number of the transition in the data.
    pub regularizer: Option<Regularizer<'a, T>>,
}

impl<T> std::fmt::Debug for Objective<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Objective").field("weights", &self.weights).finish_non_exhaustive()
    }
}

/// A model in training, with its optimiser.
#[derive(Debug)]
pub struct Trainer<T = f32> {
    /// The model.
    pub model: LceModel<T>,
    /// Its optimiser.
    pub adam: Adam<T>,
    settings: AdamSettings,
    dropout: f64,
    backend: Box<dyn TrainingBackend<T>>,
    batch: Gathered<T>,
    is_finite: bool,
}

/// Buffers that a batch is gathered into.
#[derive(Debug, Default)]
struct Gathered<T> {
    with_dropout: Option<BinaryImages>,
    pairs: Vec<u32>,
    x: Vec<u32>,
    actions: Vec<T>,
    noise: Vec<T>,
    guidance: Vec<T>,
}

impl<T: Real> Gathered<T> {
    /// Gathers a copy of each of the transitions `which`, and draws `noise_width` standard normal numbers for each.
    fn gather(&mut self, data: &Data<T>, which: &[u32], noise_width: usize, dropout: f64, rng: &mut Rng) {
        self.pairs.clear();
        self.x.clear();
        self.actions.clear();
        for &transition in which {
            let i = data.draw_copy(transition, rng);
            self.pairs.extend([2 * i, 2 * i + 1]);
            self.x.push(2 * i);
            self.actions.extend_from_slice(&data.actions[i as usize * data.action_dim..][..data.action_dim]);
        }
        self.noise.resize(which.len() * noise_width, T::ZERO);
        sampling::fill_normal(rng, &mut self.noise);
        if dropout > 0.0 {
            self.with_dropout = Some(data.images.with_dropout(&self.pairs, dropout, rng));
            self.pairs.iter_mut().zip(0..).for_each(|(image, i)| *image = i);
            self.x.iter_mut().zip(0..).for_each(|(image, i)| *image = 2 * i);
        }
    }

    /// What was gathered, for a loss that needs nothing else.
    fn transitions<'a>(&'a self, data: &'a Data<T>) -> TransitionBatch<'a, T> {
        let Self { with_dropout, pairs, x, actions, noise, .. } = self;
        TransitionBatch { images: with_dropout.as_ref().unwrap_or(&data.images), pairs, x, actions, noise }
    }
}

impl<T: Real> Trainer<T> {
    /// Trains `model` on this machine's cores, with the optimiser's state `adam`.
    pub fn new(model: LceModel<T>, adam: Adam<T>, settings: AdamSettings) -> Self {
        Self::with_backend(model, adam, settings, Box::new(Cpu::default()))
    }

    /// Trains `model` on a back end.
    pub fn with_backend(
        model: LceModel<T>,
        adam: Adam<T>,
        settings: AdamSettings,
        backend: Box<dyn TrainingBackend<T>>,
    ) -> Self {
        Self { model, adam, settings, dropout: 0.0, backend, batch: Gathered::default(), is_finite: true }
    }

    /// The networks' inputs lose this share of their patches, other patches at every step; see
    /// [`BinaryImages::with_dropout`].
    pub fn set_dropout(&mut self, share: f64) {
        self.dropout = share;
    }

    /// Changes the optimiser's step size and decay.
    pub fn set_optimizer(&mut self, settings: AdamSettings) {
        self.settings = settings;
    }

    /// Whether the last step left finite parameters and moments.
    pub fn is_finite(&self) -> bool {
        self.is_finite
    }

    /// One step of the warm-up on the transitions `which`. `decode` says whether D decodes.
    pub fn warm_up_step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        settings: &WarmUp,
        decode: bool,
        rng: &mut Rng,
    ) -> WarmUpTerms {
        self.batch.gather(data, which, 2 * self.model.sizes.latent, self.dropout, rng);
        let Gathered { with_dropout, pairs, actions, noise, .. } = &self.batch;
        let images = with_dropout.as_ref().unwrap_or(&data.images);
        let batch = WarmUpBatch { images, pairs, actions, noise, decode };
        let step = self.backend.warm_up(threads, &self.model, settings, &batch);
        self.is_finite = self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }

    /// One step of the loss on the transitions `which`.
    pub fn step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        objective: &Objective<'_, T>,
        rng: &mut Rng,
    ) -> Terms {
        let width = Noise::<T>::width(self.model.sizes.latent, self.model.sizes.action);
        self.batch.gather(data, which, width, self.dropout, rng);
        if let Some(guidance) = objective.guidance {
            self.batch.guidance.clear();
            self.batch.guidance.extend(which.iter().map(|&i| guidance[i as usize]));
        }
        let Gathered { with_dropout, pairs, x, actions, noise, guidance } = &self.batch;
        let by_sample = |sample: usize, z: &[T], weight: T, d_z: &mut [T]| {
            objective.regularizer.map_or(T::ZERO, |regularizer| regularizer(which[sample] as usize, z, weight, d_z))
        };
        let batch = Batch {
            images: with_dropout.as_ref().unwrap_or(&data.images),
            pairs,
            x,
            actions,
            noise,
            curvature_sigma: objective.curvature_sigma,
            anchor_scale: objective.anchor_scale,
            guidance: objective.guidance.map(|_| &guidance[..]),
            regularizer: objective.regularizer.map(|_| &by_sample as Regularizer<'_, T>),
        };
        let step = self.backend.loss(threads, &self.model, &objective.weights, &batch);
        self.is_finite = self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }

    /// One step of PC3's loss on the transitions `which`.
    pub fn pc3_step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        loss: &Pc3Loss,
        rng: &mut Rng,
    ) -> Pc3Terms {
        self.batch.gather(data, which, Pc3Workspace::noise_width(&self.model), self.dropout, rng);
        let step = self.backend.pc3(threads, &self.model, loss, &self.batch.transitions(data));
        self.is_finite = self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }

    /// One step of E2C's loss on the transitions `which`.
    pub fn e2c_step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        loss: &E2cLoss,
        rng: &mut Rng,
    ) -> E2cTerms {
        self.batch.gather(data, which, E2cWorkspace::noise_width(&self.model), self.dropout, rng);
        let step = self.backend.e2c(threads, &self.model, loss, &self.batch.transitions(data));
        self.is_finite = self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }

    /// One step of RCE's loss on the transitions `which`.
    pub fn rce_step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        loss: &RceLoss,
        rng: &mut Rng,
    ) -> RceTerms {
        self.batch.gather(data, which, RceWorkspace::noise_width(&self.model), self.dropout, rng);
        let step = self.backend.rce(threads, &self.model, loss, &self.batch.transitions(data));
        self.is_finite = self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }
}

#[cfg(test)]
mod tests;
