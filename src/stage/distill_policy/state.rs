//! The saved state of a distillation: the student, its optimiser, the random position and the number of steps.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::{
    artifact::{
        Files, json,
        tensors::{TensorFile, Tensors, file},
    },
    control::Agent,
    nn::adam::Adam,
    num::rng::{Position, Rng},
    stage::{
        StageState,
        state::{put_artifact, take_artifact},
    },
};

/// A distillation at work.
pub(super) struct Distillation {
    pub(super) student: Agent,
    /// Of the student's actor; the agent's own optimiser rests meanwhile.
    pub(super) adam: Adam<f32>,
    /// The random stream of the batches.
    pub(super) rng: Rng,
    /// Steps done.
    pub(super) steps: u64,
    /// The loss of the last step.
    pub(super) kl: f64,
}

#[derive(Serialize, Deserialize)]
struct About {
    steps: u64,
    adam_steps: u64,
    kl: f64,
    rng: Position,
}

impl StageState for Distillation {
    fn save(&self) -> anyhow::Result<Files> {
        let Adam { m, v, steps: adam_steps } = &self.adam;
        let mut optimizer = Tensors::default();
        optimizer.f32("m", &[m.len()], m).f32("v", &[v.len()], v);
        let about = About { steps: self.steps, adam_steps: *adam_steps, kl: self.kl, rng: Position::of(&self.rng) };
        let mut files =
            Files::from([("distillation.json", json(&about)?.into()), ("adam.safetensors", optimizer.content()?)]);
        put_artifact(&mut files, "student", self.student.clone())?;
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { steps, adam_steps, kl, rng } = serde_json::from_slice(&file(files, "distillation.json")?)?;
        let student: Agent = take_artifact(files, "student")?;
        let optimizer = TensorFile::open(files, "adam.safetensors")?;
        let adam = Adam { m: optimizer.f32("m")?, v: optimizer.f32("v")?, steps: adam_steps };
        let parameters = student.actor.arena.len();
        ensure!(adam.m.len() == parameters && adam.v.len() == parameters, "an optimiser of another actor");
        Ok(Self { student, adam, rng: rng.rng(), steps, kl })
    }
}
