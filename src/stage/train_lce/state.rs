//! Where the training of the representation stands, retrainings included.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::{
    artifact::{Files, TrainedModel, json, tensors::file},
    lce::trainer::Trainer,
    nn::adam::AdamSettings,
    record::At,
    stage::{
        StageState,
        state::{put_artifact, take_artifact},
    },
};

/// A training at work: the attempt that runs now, and the best map of the attempts before it.
pub(super) struct Training {
    /// Which attempt runs, counted from 0.
    pub(super) attempt: u64,
    /// Passes done in this attempt.
    pub(super) epoch: u64,
    /// Passes done in all attempts.
    pub(super) all_epochs: u64,
    /// Optimiser steps done in all attempts.
    pub(super) all_steps: u64,
    /// The model of this attempt and its optimiser.
    pub(super) trainer: Trainer,
    /// The best of the attempts that ended.
    pub(super) best: Option<Attempt>,
}

/// An attempt that ended.
pub(super) struct Attempt {
    /// Which one, counted from 0.
    pub(super) number: u64,
    pub(super) trained: TrainedModel,
}

impl Training {
    /// The first attempt, before its first step.
    pub(super) fn new(start: TrainedModel) -> Self {
        Self { attempt: 0, epoch: 0, all_epochs: 0, all_steps: 0, trainer: trainer(start), best: None }
    }

    /// Begins the next attempt, and keeps the best of those before it; none where all diverged.
    pub(super) fn begin_again(&mut self, best: Option<Attempt>, start: TrainedModel) {
        self.best = best;
        self.attempt += 1;
        self.epoch = 0;
        self.trainer = trainer(start);
    }

    /// The time of the next step, for recordings.
    pub(super) fn now(&self, round: u32) -> At {
        At::new(round, self.all_epochs as u32, self.all_steps)
    }

    /// Counts one more step, and gives its time.
    pub(super) fn next_step(&mut self, round: u32) -> At {
        let at = self.now(round);
        self.all_steps += 1;
        at
    }

    /// The model of the current attempt as it is now.
    pub(super) fn trained(&self) -> TrainedModel {
        let (model, adam) = (self.trainer.model.clone(), self.trainer.adam.clone());
        TrainedModel { model, adam, suspect_goals: Vec::new() }
    }
}

/// The training schedule sets step size and decay at every pass.
fn trainer(TrainedModel { model, adam, .. }: TrainedModel) -> Trainer {
    Trainer::new(model, adam, AdamSettings { learning_rate: 0.0, weight_decay: 0.0 })
}

#[derive(Serialize, Deserialize)]
struct About {
    attempt: u64,
    epoch: u64,
    all_epochs: u64,
    all_steps: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    best_attempt: Option<u64>,
}

impl StageState for Training {
    fn save(&self) -> anyhow::Result<Files> {
        let &Self { attempt, epoch, all_epochs, all_steps, .. } = self;
        let best_attempt = self.best.as_ref().map(|best| best.number);
        let about = About { attempt, epoch, all_epochs, all_steps, best_attempt };
        let mut files = Files::from([("training.json".to_owned(), json(&about)?)]);
        put_artifact(&mut files, "current", self.trained())?;
        if let Some(best) = &self.best {
            put_artifact(&mut files, "best", best.trained.clone())?;
        }
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { attempt, epoch, all_epochs, all_steps, best_attempt } =
            serde_json::from_slice(&file(files, "training.json")?)?;
        let best = match best_attempt {
            Some(number) => Some(Attempt { number, trained: take_artifact(files, "best")? }),
            None => None,
        };
        ensure!(all_epochs >= epoch, "more passes in one attempt than in all");
        Ok(Self { attempt, epoch, all_epochs, all_steps, trainer: trainer(take_artifact(files, "current")?), best })
    }
}
