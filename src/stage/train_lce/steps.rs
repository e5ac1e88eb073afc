//! One training step by the loss that is due: the warm-up's, or that of the objective.

use super::{
    attempt::{Schedule, Setup},
    curves,
    params::LossName,
    state::Training,
};
use crate::{
    lce::trainer::{BATCH, Data},
    num::rng::Rng,
    stage::{Diverged, StageCx, divergence::TrainingStep},
};

/// A loss that is worth a note while training runs.
pub(super) struct Note {
    pub(super) name: &'static str,
    pub(super) nats: f64,
}

impl Setup<'_> {
    /// Transitions of a batch.
    pub(super) fn batch(&self, is_warm_up: bool) -> usize {
        match &self.params.objective {
            LossName::Pc3(pc3) if !is_warm_up => pc3.batch as usize,
            _ => BATCH,
        }
    }

    /// A step of the warm-up on the transitions `which`.
    pub(super) fn warm_up_step(
        &self,
        data: &Data,
        which: &[u32],
        state: &mut Training,
        cx: &mut StageCx<'_>,
        rng: &mut Rng,
    ) -> Result<Note, Diverged> {
        let (at, threads, warm_up) = (state.next_step(cx.round), cx.threads.get(), &self.params.warm_up);
        let decodes = state.epoch >= warm_up.anchor_epochs;
        let terms = state.trainer.warm_up_step(threads, data, which, &warm_up.loss, decodes, rng);
        curves::warm_up(cx, at, &terms);
        let step = TrainingStep { number: at.step, learning_rate: "warm_up.learning_rate" };
        step.must_be_finite(&terms.named(), state.trainer.is_finite())?;
        Ok(Note { name: "decoding", nats: terms.prediction })
    }

    /// A step of the objective on the transitions `which`, the `number`th of `batches` in its pass.
    pub(super) fn objective_step(
        &self,
        schedule: &Schedule,
        (number, batches): (u64, u64),
        (data, which): (&Data, &[u32]),
        state: &mut Training,
        cx: &mut StageCx<'_>,
        rng: &mut Rng,
    ) -> Result<Note, Diverged> {
        let (at, threads, params) = (state.next_step(cx.round), cx.threads.get(), self.params);
        let step = (state.epoch - schedule.warm_up_epochs) * batches + number;
        let ramp = params.ramp_at(step, schedule.ramp_epochs * batches);
        let (note, losses) = match &params.objective {
            LossName::Pc3(pc3) => {
                let loss = params.pc3_at(pc3, ramp);
                let terms = state.trainer.pc3_step(threads, data, which, &loss, rng);
                curves::pc3(cx, at, &terms, &loss);
                (Note { name: "NCE", nats: terms.nce }, terms.named().to_vec())
            }
            LossName::E2c => {
                let loss = params.e2c_at(ramp);
                let terms = state.trainer.e2c_step(threads, data, which, &loss, rng);
                curves::e2c(cx, at, &terms, &loss);
                (Note { name: "decoding", nats: terms.prediction }, terms.named().to_vec())
            }
            LossName::Rce => {
                let loss = params.rce_at(ramp);
                let terms = state.trainer.rce_step(threads, data, which, &loss, rng);
                curves::rce(cx, at, &terms, &loss);
                (Note { name: "decoding", nats: terms.reconstruction }, terms.named().to_vec())
            }
            LossName::Carl | LossName::ValueGuided(_) | LossName::Pcc => {
                let objective = params.objective_at(ramp, self.regularizer.as_deref(), self.guidance.as_deref());
                let terms = state.trainer.step(threads, data, which, &objective, rng);
                curves::loss(cx, at, &terms, &objective.weights);
                (Note { name: "decoding", nats: terms.deterministic }, terms.named().to_vec())
            }
        };
        let step = TrainingStep { number: at.step, learning_rate: "learning_rate" };
        step.must_be_finite(&losses, state.trainer.is_finite())?;
        Ok(note)
    }
}
