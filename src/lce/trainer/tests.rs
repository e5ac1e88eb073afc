use rand::SeedableRng as _;

use super::*;
use crate::{
    lce::{
        backend::TermsAndGradient,
        model::background,
        passive_dynamics::PassiveDynamics,
        sizes::{BackwardSizes, ImageNetworks, Sizes},
    },
    num::instruction_sets::on_every_instruction_set,
};

/// Every term that needs no regularizer.
const WEIGHTS: Weights = Weights {
    reconstruction: 1.0,
    consistency: 7.0,
    curvature: 1.0,
    encode_decode: 0.01,
    prior: 0.01,
    deterministic: 0.3,
    regularizer: 0.0,
    anchor: 3.0,
};

fn dense() -> Sizes {
    Sizes {
        shades: None,
        pixels: 75,
        latent: 2,
        action: 2,
        images: ImageNetworks::Dense,
        jacobian_heads: true,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::Quadratic,
        encoder: [70, 33],
        decoder: [21, 40],
        dynamics: [9, 8],
        backward: BackwardSizes { z: 3, u: 4, x: 50, joint: 21 },
    }
}

fn convolutional() -> Sizes {
    let images = ImageNetworks::Convolutional { frames: 1, rows: 8, columns: 8 };
    Sizes { pixels: 8 * 8, images, encoder: [10, 12], decoder: [12, 10], ..dense() }
}

#[test]
fn every_instruction_set_trains_to_the_same_bits() {
    // Without vector instructions a fused multiply-add is a function call, so the convolutional case is small.
    for (sizes, count, steps) in [(dense(), 11, 3), (convolutional(), 2, 1)] {
        let mut rng = Rng::seed_from_u64(1);
        let frames: Vec<u8> =
            (0..2 * count * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 6) == 0)).collect();
        let actions: Vec<f32> = (0..2 * count).map(|_| sampling::uniform(&mut rng, -1.0, 1.0)).collect();
        let model = LceModel::<f32>::new(sizes.clone(), background(&frames, sizes.pixels), &mut rng);
        let data = Data { images: model.pictures(&frames), actions, action_dim: 2, copies: 1 };
        let which: Vec<u32> = (0..count as u32).collect();
        let weights = WEIGHTS;
        let objective =
            Objective { weights, curvature_sigma: 0.1, anchor_scale: 1.0, guidance: None, regularizer: None };
        let warm_up = WarmUp { sigma: 0.3, scale: 1.0, anchor: 30.0, huber_delta: 3.0, shrink: 0.01 };
        let pc3 = Pc3Loss { nce: 1.0, consistency: 1.0, curvature: 7.0, sigma: 0.1, ..Pc3Loss::default() };
        on_every_instruction_set(|| {
            let settings = AdamSettings { learning_rate: 1e-3, weight_decay: 1e-3 };
            let mut trainer = Trainer::new(model.clone(), Adam::new(model.arena.len()), settings);
            let mut rng = Rng::seed_from_u64(2);
            for _ in 0..steps {
                trainer.warm_up_step(1, &data, &which, &warm_up, true, &mut rng);
                trainer.step(1, &data, &which, &objective, &mut rng);
                trainer.pc3_step(1, &data, &which, &pc3, &mut rng);
            }
            let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            (bits(&trainer.model.arena), bits(&trainer.model.encode(&data.images)))
        });
    }
}

#[test]
fn a_batch_takes_one_copy_of_each_transition_at_random() {
    let (transitions, copies) = (3, 4);
    let mut images = BinaryImages::new(&[0; 4]);
    images.extend(&[1; 2 * 3 * 4 * 4]);
    let actions = (0..transitions * copies).map(|at| at as f32).collect();
    let data = Data { images, actions, action_dim: 1, copies };
    assert_eq!(data.len(), transitions);
    let (mut batch, mut rng, mut seen) = (Gathered::default(), Rng::seed_from_u64(3), [[0; 4]; 3]);
    for _ in 0..100 {
        batch.gather(&data, &[2, 0], 1, 0.0, &mut rng);
        for (place, transition) in [2, 0].into_iter().enumerate() {
            let at = batch.actions[place] as u32;
            assert_eq!(at % 3, transition);
            assert_eq!((&batch.pairs[2 * place..][..2], batch.x[place]), (&[2 * at, 2 * at + 1][..], 2 * at));
            seen[transition as usize][at as usize / 3] += 1;
        }
    }
    assert!([seen[0], seen[2]].as_flattened().iter().all(|&count| count > 10), "{seen:?}");
    let single = Data { copies: 1, ..data };
    batch.gather(&single, &[2, 0], 1, 0.0, &mut rng);
    assert_eq!(batch.actions, [2.0, 0.0]);
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

    fn pc3(
        &mut self,
        _: usize,
        _: &LceModel<f64>,
        _: &Pc3Loss,
        batch: &TransitionBatch<'_, f64>,
    ) -> TermsAndGradient<'_, Pc3Terms, f64> {
        let terms = Pc3Terms { nce: batch.noise.len() as f64, ..Pc3Terms::default() };
        TermsAndGradient { terms, gradient: &self.0 }
    }

    fn e2c(
        &mut self,
        _: usize,
        _: &LceModel<f64>,
        _: &E2cLoss,
        batch: &TransitionBatch<'_, f64>,
    ) -> TermsAndGradient<'_, E2cTerms, f64> {
        let terms = E2cTerms { prior: batch.noise.len() as f64, ..E2cTerms::default() };
        TermsAndGradient { terms, gradient: &self.0 }
    }

    fn rce(
        &mut self,
        _: usize,
        _: &LceModel<f64>,
        _: &RceLoss,
        batch: &TransitionBatch<'_, f64>,
    ) -> TermsAndGradient<'_, RceTerms, f64> {
        let terms = RceTerms { entropy: batch.noise.len() as f64, ..RceTerms::default() };
        TermsAndGradient { terms, gradient: &self.0 }
    }
}

#[test]
fn a_trainer_steps_along_its_back_ends_gradient_and_returns_its_terms() {
    let mut rng = Rng::seed_from_u64(1);
    let sizes = Sizes { pixels: 4, encoder: [3, 3], decoder: [3, 3], ..Sizes::planar() };
    let model = LceModel::<f64>::new(sizes, vec![0; 4], &mut rng);
    let data = Data { images: model.pictures(&[1; 3 * 2 * 4]), actions: vec![0.5; 6], action_dim: 2, copies: 1 };
    let (count, settings) = (model.arena.len(), AdamSettings { learning_rate: 0.25, weight_decay: 0.0 });
    let before = model.arena.clone();
    let mut trainer = Trainer::with_backend(model, Adam::new(count), settings, Box::new(Ones(vec![1.0; count])));
    let weights = Weights::default();
    let objective = Objective { weights, curvature_sigma: 0.1, anchor_scale: 1.0, guidance: None, regularizer: None };
    assert_eq!(trainer.warm_up_step(1, &data, &[0, 2], &WarmUp::default(), true, &mut rng).anchor, 4.0);
    assert_eq!(trainer.step(1, &data, &[0, 1, 2], &objective, &mut rng).curvature, 3.0);
    assert_eq!(trainer.pc3_step(1, &data, &[1], &Pc3Loss::default(), &mut rng).nce, 6.0);
    assert_eq!(trainer.e2c_step(1, &data, &[1], &E2cLoss::default(), &mut rng).prior, 2.0);
    assert_eq!(trainer.rce_step(1, &data, &[1], &RceLoss::default(), &mut rng).entropy, 4.0);
    assert!(trainer.model.arena.iter().zip(&before).all(|(after, before)| (before - after - 1.25).abs() < 1e-6));
}
