//! Trains an LCE model on transitions: batches, noise, the schedule of the loss, Adam.

use super::{
    model::LceModel,
    objective::{Batch, Regularizer, Terms, Weights, Workspace, noise_width},
    warm_up::{WarmUp, WarmUpBatch, WarmUpTerms, WarmUpWorkspace},
};
use crate::{
    nn::{
        adam::{Adam, AdamSettings},
        binary_images::BinaryImages,
    },
    num::{Real, rng::Rng, sampling},
};

/// Samples of a batch (paper, "Training Hyper-Parameters").
pub const BATCH: usize = 128;

/// Transitions (x, u, x') in the form that training reads. No state is in it.
#[derive(Debug, Clone)]
pub struct Data<T = f32> {
    /// BinaryImages 2i and 2i + 1 are x and x' of transition i.
    pub pictures: BinaryImages,
    /// Actions in -1..1, one column for every transition.
    pub actions: Vec<T>,
    /// Components of an action.
    pub action_dim: usize,
}

impl<T> Data<T> {
    /// How many transitions.
    pub fn len(&self) -> usize {
        self.actions.len() / self.action_dim
    }

    /// True without transitions.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }
}

/// The paper's loss as it is used in training.
#[derive(Clone, Copy)]
pub struct Objective<'a, T> {
    /// Weights of the terms.
    pub weights: Weights,
    /// The curvature's standard deviation.
    pub curvature_sigma: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
    /// Value-guided weights for every transition of the data.
    pub guidance: Option<&'a [T]>,
    /// L_reg by transition of the data.
    pub regularizer: Option<Regularizer<'a, T>>,
}

impl<T> std::fmt::Debug for Objective<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Objective").field("weights", &self.weights).finish_non_exhaustive()
    }
}

/// A model in training: its optimiser and buffers.
#[derive(Debug)]
pub struct Trainer<T = f32> {
    /// The model.
    pub model: LceModel<T>,
    /// Its optimiser.
    pub adam: Adam<T>,
    settings: AdamSettings,
    dropout: f64,
    /// Buffers of the loss or of the warm-up: whichever was asked last, since they are large.
    buffers: Buffers<T>,
    batch: Gathered<T>,
}

#[derive(Debug, Default)]
#[allow(clippy::large_enum_variant, reason = "there is one of it in a trainer")]
enum Buffers<T> {
    #[default]
    None,
    Loss(Workspace<T>),
    WarmUp(WarmUpWorkspace<T>),
}

impl<T: Real> Buffers<T> {
    fn loss(&mut self, model: &LceModel<T>) -> &mut Workspace<T> {
        if !matches!(self, Self::Loss(_)) {
            *self = Self::None;
            *self = Self::Loss(Workspace::new(model, BATCH));
        }
        let Self::Loss(workspace) = self else { unreachable!("made above") };
        workspace
    }

    fn warm_up(&mut self, model: &LceModel<T>) -> &mut WarmUpWorkspace<T> {
        if !matches!(self, Self::WarmUp(_)) {
            *self = Self::None;
            *self = Self::WarmUp(WarmUpWorkspace::new(model, BATCH));
        }
        let Self::WarmUp(workspace) = self else { unreachable!("made above") };
        workspace
    }
}

/// Buffers for what a batch is gathered into.
#[derive(Debug, Default)]
struct Gathered<T> {
    thinned: Option<BinaryImages>,
    pairs: Vec<u32>,
    x: Vec<u32>,
    actions: Vec<T>,
    noise: Vec<T>,
    guidance: Vec<T>,
}

impl<T: Real> Gathered<T> {
    fn gather(&mut self, data: &Data<T>, which: &[u32], noise_width: usize, dropout: f64, rng: &mut Rng) {
        self.pairs.clear();
        self.x.clear();
        self.actions.clear();
        for &i in which {
            self.pairs.extend([2 * i, 2 * i + 1]);
            self.x.push(2 * i);
            self.actions.extend_from_slice(&data.actions[i as usize * data.action_dim..][..data.action_dim]);
        }
        self.noise.resize(which.len() * noise_width, T::ZERO);
        sampling::fill_normal(rng, &mut self.noise);
        if dropout > 0.0 {
            self.thinned = Some(data.pictures.with_dropout(&self.pairs, dropout, rng));
            self.pairs.iter_mut().zip(0..).for_each(|(picture, i)| *picture = i);
            self.x.iter_mut().zip(0..).for_each(|(picture, i)| *picture = 2 * i);
        }
    }
}

impl<T: Real> Trainer<T> {
    /// Goes on training `model` with the optimiser's state.
    pub fn new(model: LceModel<T>, adam: Adam<T>, settings: AdamSettings) -> Self {
        Self { model, adam, settings, dropout: 0.0, buffers: Buffers::None, batch: Gathered::default() }
    }

    /// Networks miss this share of the squares that they read, others at every step: see [`BinaryImages::with_dropout`].
    pub fn set_dropout(&mut self, share: f64) {
        self.dropout = share;
    }

    /// Changes the optimiser's step size.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.settings.learning_rate = learning_rate;
    }

    /// One step of the warm-up on the transitions `which`, with or without decoding pictures.
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
        let Gathered { thinned, pairs, actions, noise, .. } = &self.batch;
        let pictures = thinned.as_ref().unwrap_or(&data.pictures);
        let batch = WarmUpBatch { pictures, pairs, actions, noise, decode };
        let workspace = self.buffers.warm_up(&self.model);
        let terms = workspace.step(threads, &self.model, settings, &batch);
        self.adam.step(threads, self.settings, &mut self.model.arena, workspace.gradient());
        terms
    }

    /// One step of the paper's loss on the transitions `which`.
    pub fn step(
        &mut self,
        threads: usize,
        data: &Data<T>,
        which: &[u32],
        objective: &Objective<'_, T>,
        rng: &mut Rng,
    ) -> Terms {
        let width = noise_width(self.model.sizes.latent, self.model.sizes.action);
        self.batch.gather(data, which, width, self.dropout, rng);
        if let Some(guidance) = objective.guidance {
            self.batch.guidance.clear();
            self.batch.guidance.extend(which.iter().map(|&i| guidance[i as usize]));
        }
        let Gathered { thinned, pairs, x, actions, noise, guidance } = &self.batch;
        let by_sample = |sample: usize, z: &[T], weight: T, d_z: &mut [T]| {
            objective.regularizer.map_or(T::ZERO, |regularizer| regularizer(which[sample] as usize, z, weight, d_z))
        };
        let batch = Batch {
            pictures: thinned.as_ref().unwrap_or(&data.pictures),
            pairs,
            x,
            actions,
            noise,
            curvature_sigma: objective.curvature_sigma,
            anchor_scale: objective.anchor_scale,
            guidance: objective.guidance.map(|_| &guidance[..]),
            regularizer: objective.regularizer.map(|_| &by_sample as Regularizer<'_, T>),
        };
        let workspace = self.buffers.loss(&self.model);
        let terms = workspace.step(threads, &self.model, &objective.weights, &batch);
        self.adam.step(threads, self.settings, &mut self.model.arena, workspace.gradient());
        terms
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{Sizes, model::background},
        num::simd::tests::on_every_instruction_set,
    };

    #[test]
    fn every_instruction_set_trains_to_the_same_bits() {
        let dense = Sizes {
            pixels: 75,
            latent: 2,
            action: 2,
            convolution: None,
            squares: None,
            slopes: true,
            drift: crate::lce::Drift::Quadratic,
            encoder: [70, 33],
            decoder: [21, 40],
            dynamics: [9, 8],
            backward: [3, 4, 50, 21],
        };
        let convolution = Sizes {
            pixels: 8 * 8,
            convolution: Some([1, 8, 8]),
            squares: None,
            encoder: [10, 12],
            decoder: [12, 10],
            ..dense.clone()
        };
        // Without vectors every fused multiply-add is a call, so the convolutions get little to do.
        for (sizes, count, steps) in [(dense, 11, 3), (convolution, 2, 1)] {
            let mut rng = Rng::seed_from_u64(1);
            let frames: Vec<u8> =
                (0..2 * count * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 6) == 0)).collect();
            let actions: Vec<f32> = (0..2 * count).map(|_| sampling::uniform(&mut rng, -1.0, 1.0)).collect();
            let model = LceModel::<f32>::new(sizes.clone(), background(&frames, sizes.pixels), &mut rng);
            let data = Data { pictures: model.pictures(&frames), actions, action_dim: 2 };
            let which: Vec<u32> = (0..count as u32).collect();
            let weights = Weights {
                reconstruction: 1.0,
                consistency: 7.0,
                curvature: 1.0,
                encode_decode: 0.01,
                prior: 0.01,
                deterministic: 0.3,
                regularizer: 0.0,
                anchor: 3.0,
            };
            let objective =
                Objective { weights, curvature_sigma: 0.1, anchor_scale: 1.0, guidance: None, regularizer: None };
            let warm_up = WarmUp { sigma: 0.3, scale: 1.0, anchor: 30.0, outlier: 3.0, shrink: 0.01 };
            on_every_instruction_set(|| {
                let settings = AdamSettings { learning_rate: 1e-3, weight_decay: 1e-3 };
                let mut trainer = Trainer::new(model.clone(), Adam::new(model.arena.len()), settings);
                let mut rng = Rng::seed_from_u64(2);
                for _ in 0..steps {
                    trainer.warm_up_step(1, &data, &which, &warm_up, true, &mut rng);
                    trainer.step(1, &data, &which, &objective, &mut rng);
                }
                let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                (bits(&trainer.model.arena), bits(&trainer.model.encode(&data.pictures)))
            });
        }
    }
}
