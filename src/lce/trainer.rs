//! Trains an LCE model on transitions: gathers batches, draws noise, asks a back end for gradients, steps Adam.

use super::{
    backend::{Cpu, TrainingBackend},
    model::LceModel,
    objective::{Batch, Noise, Regularizer, Terms, Weights},
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
    /// Images 2i and 2i + 1 are x and x' of transition i.
    pub images: BinaryImages,
    /// Actions in -1..1, one column for every transition.
    pub actions: Vec<T>,
    /// Components of an action.
    pub action_dim: usize,
}

impl<T> Data<T> {
    /// How many transitions there are.
    pub fn len(&self) -> usize {
        self.actions.len() / self.action_dim
    }

    /// Whether there are no transitions.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
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
    /// Gathers the transitions `which`, and draws `noise_width` standard normal numbers for each.
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
            self.with_dropout = Some(data.images.with_dropout(&self.pairs, dropout, rng));
            self.pairs.iter_mut().zip(0..).for_each(|(image, i)| *image = i);
            self.x.iter_mut().zip(0..).for_each(|(image, i)| *image = 2 * i);
        }
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
        Self { model, adam, settings, dropout: 0.0, backend, batch: Gathered::default() }
    }

    /// The networks' inputs lose this share of their patches, other patches at every step; see
    /// [`BinaryImages::with_dropout`].
    pub fn set_dropout(&mut self, share: f64) {
        self.dropout = share;
    }

    /// Changes the optimiser's step size.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.settings.learning_rate = learning_rate;
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
        self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
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
        self.adam.step(threads, self.settings, &mut self.model.arena, step.gradient);
        step.terms
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{
            backend::TermsAndGradient,
            model::background,
            passive_dynamics::PassiveDynamics,
            sizes::{BackwardSizes, ImageNetworks, Sizes},
        },
        num::simd::tests::on_every_instruction_set,
    };

    #[test]
    fn every_instruction_set_trains_to_the_same_bits() {
        let dense = Sizes {
            pixels: 75,
            latent: 2,
            action: 2,
            images: ImageNetworks::Dense,
            jacobian_heads: true,
            passive_dynamics: PassiveDynamics::Quadratic,
            encoder: [70, 33],
            decoder: [21, 40],
            dynamics: [9, 8],
            backward: BackwardSizes { z: 3, u: 4, x: 50, joint: 21 },
        };
        let convolution = Sizes {
            pixels: 8 * 8,
            images: ImageNetworks::Convolutional { frames: 1, rows: 8, columns: 8 },
            encoder: [10, 12],
            decoder: [12, 10],
            ..dense.clone()
        };
        // Without vector instructions a fused multiply-add is a function call, so the convolutional case is small.
        for (sizes, count, steps) in [(dense, 11, 3), (convolution, 2, 1)] {
            let mut rng = Rng::seed_from_u64(1);
            let frames: Vec<u8> =
                (0..2 * count * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 6) == 0)).collect();
            let actions: Vec<f32> = (0..2 * count).map(|_| sampling::uniform(&mut rng, -1.0, 1.0)).collect();
            let model = LceModel::<f32>::new(sizes.clone(), background(&frames, sizes.pixels), &mut rng);
            let data = Data { images: model.pictures(&frames), actions, action_dim: 2 };
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
            let warm_up = WarmUp { sigma: 0.3, scale: 1.0, anchor: 30.0, huber_delta: 3.0, shrink: 0.01 };
            on_every_instruction_set(|| {
                let settings = AdamSettings { learning_rate: 1e-3, weight_decay: 1e-3 };
                let mut trainer = Trainer::new(model.clone(), Adam::new(model.arena.len()), settings);
                let mut rng = Rng::seed_from_u64(2);
                for _ in 0..steps {
                    trainer.warm_up_step(1, &data, &which, &warm_up, true, &mut rng);
                    trainer.step(1, &data, &which, &objective, &mut rng);
                }
                let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                (bits(&trainer.model.arena), bits(&trainer.model.encode(&data.images)))
            });
        }
    }

    /// A back end whose gradient is 1 for every parameter.
    #[derive(Debug)]
    struct Ones(Vec<f64>);

    impl TrainingBackend<f64> for Ones {
        fn platform(&self) -> &'static str {
            "ones"
        }

        fn loss(
            &mut self,
            _: usize,
            _: &LceModel<f64>,
            _: &Weights,
            batch: &Batch<'_, f64>,
        ) -> TermsAndGradient<'_, Terms, f64> {
            let terms = Terms { curvature: batch.x.len() as f64, ..Terms::default() };
            TermsAndGradient { terms, gradient: &self.0 }
        }

        fn warm_up(
            &mut self,
            _: usize,
            _: &LceModel<f64>,
            _: &WarmUp,
            batch: &WarmUpBatch<'_, f64>,
        ) -> TermsAndGradient<'_, WarmUpTerms, f64> {
            let terms = WarmUpTerms { anchor: batch.pairs.len() as f64, ..WarmUpTerms::default() };
            TermsAndGradient { terms, gradient: &self.0 }
        }
    }

    #[test]
    fn a_trainer_steps_along_its_back_ends_gradient_and_returns_its_terms() {
        let mut rng = Rng::seed_from_u64(1);
        let sizes = Sizes { pixels: 4, encoder: [3, 3], decoder: [3, 3], ..Sizes::planar() };
        let model = LceModel::<f64>::new(sizes, vec![0; 4], &mut rng);
        let data = Data { images: model.pictures(&[1; 3 * 2 * 4]), actions: vec![0.5; 6], action_dim: 2 };
        let (count, settings) = (model.arena.len(), AdamSettings { learning_rate: 0.25, weight_decay: 0.0 });
        let before = model.arena.clone();
        let mut trainer = Trainer::with_backend(model, Adam::new(count), settings, Box::new(Ones(vec![1.0; count])));
        let weights = Weights::default();
        let objective =
            Objective { weights, curvature_sigma: 0.1, anchor_scale: 1.0, guidance: None, regularizer: None };
        assert_eq!(trainer.warm_up_step(1, &data, &[0, 2], &WarmUp::default(), true, &mut rng).anchor, 4.0);
        assert_eq!(trainer.step(1, &data, &[0, 1, 2], &objective, &mut rng).curvature, 3.0);
        assert!(trainer.model.arena.iter().zip(&before).all(|(after, before)| (before - after - 0.5).abs() < 1e-6));
    }
}
