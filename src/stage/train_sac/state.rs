//! The saved state of SAC: agent, latent buffer, random position and number of updates.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::{
    artifact::{
        Files, json,
        tensors::{TensorFile, Tensors, file},
    },
    control::sac::{LatentBuffer, Learner},
    num::rng::Position,
    stage::{
        StageState,
        state::{put_artifact, take_artifact},
    },
};

/// Everything beside the tensors.
#[derive(Serialize, Deserialize)]
struct About {
    steps: u64,
    rng: Position,
    buffer_width: usize,
    buffer_capacity: usize,
    buffer_next: usize,
}

impl StageState for Learner {
    fn save(&self) -> anyhow::Result<Files> {
        let Self { agent, buffer, rng, steps } = self;
        let mut tensors = Tensors::default();
        tensors.f32("buffer", &[buffer.columns.len() / buffer.width, buffer.width], &buffer.columns);
        let about = About {
            steps: *steps,
            rng: Position::of(rng),
            buffer_width: buffer.width,
            buffer_capacity: buffer.capacity,
            buffer_next: buffer.next,
        };
        let mut files =
            Files::from([("learner.json", json(&about)?.into()), ("buffer.safetensors", tensors.content()?)]);
        put_artifact(&mut files, "agent", agent.clone())?;
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let about: About = serde_json::from_slice(&file(files, "learner.json")?)?;
        let columns = TensorFile::open(files, "buffer.safetensors")?.f32("buffer")?;
        let (width, capacity) = (about.buffer_width, about.buffer_capacity);
        let buffer = LatentBuffer { columns, width, capacity, next: about.buffer_next };
        let agent: crate::control::Agent = take_artifact(files, "agent")?;
        ensure!(
            width == 3 * agent.latent + agent.action
                && buffer.columns.len().is_multiple_of(width)
                && buffer.columns.len() / width <= capacity
                && buffer.next < capacity,
            "a latent buffer that does not fit its agent"
        );
        Ok(Self { agent, buffer, rng: about.rng.rng(), steps: about.steps })
    }
}
