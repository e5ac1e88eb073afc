//! One training attempt: from a new model or the model of the round before to a trained one, pass by pass.

use super::{
    curves,
    params::{Params, Refit, Slopes},
    state::Training,
    steps::Note,
    terms::OwnedRegularizer,
};
use crate::{
    artifact::{TrainedModel, Transitions},
    lce::{refit::refit, trainer::Data},
    nn::adam::AdamSettings,
    num::sampling,
    record::At,
    stage::{Diverged, StageCx, divergence::TrainingStep},
};

/// What every attempt trains with.
pub(super) struct Setup<'a> {
    pub(super) params: &'a Params,
    pub(super) transitions: &'a Transitions,
    /// L_reg, the loss that keeps the old policy.
    pub(super) regularizer: Option<OwnedRegularizer<'a>>,
    /// Weights of the transitions in value-guided CARL.
    pub(super) guidance: Option<Vec<f32>>,
    /// Whether the first attempt starts from the model of the round before.
    pub(super) has_warm_start: bool,
}

/// The passes of one attempt.
pub(super) struct Schedule {
    epochs: u64,
    /// Of these, passes with the anchored warm-up, at the beginning.
    pub(super) warm_up_epochs: u64,
    /// Passes after the warm-up over which the consistency weight grows.
    pub(super) ramp_epochs: u64,
}

impl Schedule {
    /// The passes of attempt number `attempt`, counted from 0. An attempt with a model of the round before needs no
    /// warm-up. Where a new model replaces such an attempt, warm-up and ramp come on top of `epochs`.
    fn of(setup: &Setup<'_>, attempt: u64) -> Self {
        let Params { epochs, warm_up, ramp, .. } = setup.params;
        let (epochs, warm_up_epochs, ramp_epochs) = (*epochs, warm_up.epochs, ramp.epochs);
        match (setup.has_warm_start, attempt) {
            (true, 0) => Self { epochs, warm_up_epochs: 0, ramp_epochs: 0 },
            (true, _) => Self { epochs: warm_up_epochs + ramp_epochs + epochs, warm_up_epochs, ramp_epochs },
            (false, _) => Self { epochs, warm_up_epochs, ramp_epochs },
        }
    }
}

impl Setup<'_> {
    /// Trains the model of the current attempt to the end of its schedule.
    pub(super) fn train(&self, state: &mut Training, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        let schedule = Schedule::of(self, state.attempt);
        let Params { symmetries, symmetric_copies, .. } = self.params;
        let copies = cx.symmetric_copies(self.transitions, symmetries, *symmetric_copies);
        let data = copies.data(&state.trainer.model);
        let probe = cx.map_probe();
        let earlier_epochs = state.all_epochs - state.epoch;
        while state.epoch < schedule.epochs {
            let Note { name, nats } = self.train_epoch(&schedule, &data, state, cx)?;
            if state.epoch.is_multiple_of(self.params.map_every) || state.epoch + 1 == schedule.epochs {
                let at = At::new(cx.round, state.all_epochs as u32, state.all_steps - 1);
                probe.record(&state.trainer.model, cx.record, at);
                let decodes = self.params.objective.decodes();
                curves::images(cx, at, self.transitions, &state.trainer.model, decodes);
            }
            state.epoch += 1;
            state.all_epochs += 1;
            let note = format!("{name} {nats:.1} nats");
            cx.tick(state.all_epochs, earlier_epochs + schedule.epochs, &note, state)?;
        }
        let mut trained = state.trained();
        if let Some(sigma) = self.params.objective.code_sigma() {
            trained.model.set_code_sigma(sigma as f32);
        }
        if let Slopes::Exact(Refit { refit_steps: steps @ 1.. }) = self.params.slopes {
            let codes = trained.model.encode(&data.images);
            let (rng, learning_rate) = (&mut cx.rng(("refit", state.attempt)), self.params.warm_up.learning_rate);
            let refitted = refit(&mut trained.model, &codes, &data.actions, steps, learning_rate, rng);
            let step = |number| TrainingStep { number, learning_rate: "warm_up.learning_rate" };
            refitted
                .map_err(|number| step(number).diverged("a weight of the dynamics F is not finite in the refit"))?;
        }
        Ok(trained)
    }

    /// One pass over the transitions in random order. Gives a loss of the last batch.
    fn train_epoch(
        &self,
        schedule: &Schedule,
        data: &Data,
        state: &mut Training,
        cx: &mut StageCx<'_>,
    ) -> Result<Note, Diverged> {
        let params = self.params;
        let is_warm_up = state.epoch < schedule.warm_up_epochs;
        let learning_rate = if is_warm_up { params.warm_up.learning_rate } else { params.learning_rate };
        state.trainer.set_optimizer(AdamSettings { learning_rate, weight_decay: params.weight_decay });
        state.trainer.set_dropout(if state.trainer.model.sizes.read_patches().is_some() {
            params.networks.dropout()
        } else {
            0.0
        });
        let mut rng = cx.rng(("batches", state.attempt << 32 | state.epoch));
        let order = sampling::shuffled(&mut rng, data.len());
        let batch = self.batch(is_warm_up);
        let batches = order.len().div_ceil(batch) as u64;
        let mut note = None;
        for (number, which) in order.chunks(batch).enumerate() {
            note = Some(if is_warm_up {
                self.warm_up_step(data, which, state, cx, &mut rng)?
            } else {
                let place = (number as u64, batches);
                self.objective_step(schedule, place, (data, which), state, cx, &mut rng)?
            });
        }
        Ok(note.expect("there are transitions"))
    }
}
