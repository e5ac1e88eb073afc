//! Transitions (x, u, x') with their goals. They hold no true state, so training cannot use one.

use anyhow::ensure;

use super::{
    Artifact, Files,
    tensors::{TensorFile, Tensors},
};

/// Transitions as pictures and actions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Transitions {
    /// Height and width of a picture.
    pub picture: (usize, usize),
    /// Components of an action.
    pub action_dim: usize,
    /// x, one picture after the other, from 0 for black to 255 for white.
    pub observations: Vec<u8>,
    /// u in -1..1, one after the other.
    pub actions: Vec<f32>,
    /// x', as `observations`.
    pub next_observations: Vec<u8>,
    /// Goal images x_g.
    pub goals: Vec<u8>,
    /// For each transition, the index of the goal of its episode.
    pub goal_index: Vec<u32>,
}

impl Transitions {
    /// How many transitions there are.
    pub fn len(&self) -> usize {
        self.goal_index.len()
    }

    /// Whether there are no transitions.
    pub fn is_empty(&self) -> bool {
        self.goal_index.is_empty()
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> usize {
        self.picture.0 * self.picture.1
    }

    /// Bytes that `count` transitions take in memory, with observations of so many pixels.
    pub fn memory(count: u64, pixels: usize) -> u64 {
        count.saturating_mul(2 * pixels as u64)
    }

    /// Makes room for `count` more transitions.
    ///
    /// # Errors
    /// The machine has not so much memory.
    pub fn reserve(&mut self, count: usize) -> Result<(), std::collections::TryReserveError> {
        let pixels = count.saturating_mul(self.pixels());
        self.observations.try_reserve_exact(pixels)?;
        self.next_observations.try_reserve_exact(pixels)?;
        self.actions.try_reserve_exact(count.saturating_mul(self.action_dim))?;
        self.goal_index.try_reserve_exact(count)
    }

    /// Adds a transition.
    pub fn push(&mut self, observation: &[u8], action: &[f32], next_observation: &[u8], goal: u32) {
        self.observations.extend_from_slice(observation);
        self.actions.extend_from_slice(action);
        self.next_observations.extend_from_slice(next_observation);
        self.goal_index.push(goal);
    }

    /// The transitions of several artifacts, in their order.
    ///
    /// # Errors
    /// The artifacts are of different tasks.
    pub fn concat(parts: &[Self]) -> anyhow::Result<Self> {
        let Some((first, rest)) = parts.split_first() else { return Ok(Self::default()) };
        let mut all = first.clone();
        for part in rest {
            ensure!(
                part.picture == all.picture && part.action_dim == all.action_dim && part.goals == all.goals,
                "transitions of different tasks cannot be joined"
            );
            all.observations.extend_from_slice(&part.observations);
            all.actions.extend_from_slice(&part.actions);
            all.next_observations.extend_from_slice(&part.next_observations);
            all.goal_index.extend_from_slice(&part.goal_index);
        }
        Ok(all)
    }

    /// The observations x and x' of every transition in turn: images 2i and 2i + 1 belong to transition i.
    pub fn frames(&self) -> Vec<u8> {
        let pixels = self.pixels();
        let pairs = self.observations.chunks_exact(pixels).zip(self.next_observations.chunks_exact(pixels));
        pairs.flat_map(|(now, next)| now.iter().chain(next)).copied().collect()
    }
}

const FILE: &str = "transitions.safetensors";

impl Artifact for Transitions {
    const TYPE: &'static str = "transitions";

    fn save(self) -> anyhow::Result<Files> {
        let (height, width) = self.picture;
        let count = self.len();
        let mut tensors = Tensors::default();
        tensors
            .u8("observations", &[count, height, width], self.observations)
            .f32("actions", &[count, self.action_dim], &self.actions)
            .u8("next_observations", &[count, height, width], self.next_observations)
            .u8("goals", &[self.goals.len().checked_div(height * width).unwrap_or_default(), height, width], self.goals)
            .u32("goal_index", &[count], &self.goal_index);
        Ok(Files::from([(FILE, tensors.content()?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let tensors = TensorFile::open(files, FILE)?;
        let shape = |name, dimensions| tensors.shape_of(name, dimensions);
        let (observations, actions, goals) = (shape("observations", 3)?, shape("actions", 2)?, shape("goals", 3)?);
        let (count, picture) = (observations[0], &observations[1..]);
        let pixels = picture[0].checked_mul(picture[1]).unwrap_or_default();
        ensure!(pixels > 0 && actions[1] > 0, "pictures or actions without numbers");
        ensure!(
            shape("next_observations", 3)? == observations && actions[0] == count && shape("goal_index", 1)? == [count],
            "tensors of different lengths"
        );
        ensure!(&goals[1..] == picture, "goal images of another size");
        let goal_index = tensors.u32("goal_index")?;
        ensure!(goal_index.iter().all(|&goal| (goal as usize) < goals[0]), "a goal index without a goal image");
        Ok(Self {
            picture: (picture[0], picture[1]),
            action_dim: actions[1],
            observations: tensors.u8("observations")?,
            actions: tensors.f32("actions")?,
            next_observations: tensors.u8("next_observations")?,
            goals: tensors.u8("goals")?,
            goal_index,
        })
    }
}
