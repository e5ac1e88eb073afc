//! Whole episodes as pictures and actions. They hold no true state, so training cannot use one.

use anyhow::ensure;

use super::{
    Artifact, Files,
    tensors::{TensorFile, Tensors},
};

/// Episodes, one after the other. An action leads from its picture to the next picture of the episode; the last action of
/// an episode leads nowhere.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectories {
    /// Height and width of a picture.
    pub picture: (usize, usize),
    /// Components of an action.
    pub action_dim: usize,
    /// Where each episode begins among the steps, then the number of all steps.
    pub bounds: Vec<u32>,
    /// x, one picture after the other, from 0 for black to 255 for white.
    pub observations: Vec<u8>,
    /// u in -1..1, one after the other.
    pub actions: Vec<f32>,
    /// The observed cost of every step; none where no costs are observed.
    pub costs: Vec<f32>,
    /// Goal images x_g.
    pub goals: Vec<u8>,
    /// The number of each episode's goal.
    pub goal_index: Vec<u32>,
}

impl Trajectories {
    /// How many episodes there are.
    pub fn len(&self) -> usize {
        self.goal_index.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.goal_index.is_empty()
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> usize {
        self.picture.0 * self.picture.1
    }

    /// Ends an episode after the steps that were added, towards a goal of this number.
    pub fn end_episode(&mut self, goal: u32) {
        if self.bounds.is_empty() {
            self.bounds.push(0);
        }
        self.bounds.push((self.actions.len() / self.action_dim) as u32);
        self.goal_index.push(goal);
    }

    /// The steps of every episode, where all have the same number of steps.
    ///
    /// # Errors
    /// There is no episode, or episodes differ in length.
    pub fn steps(&self) -> anyhow::Result<usize> {
        let mut lengths = self.bounds.windows(2).map(|pair| (pair[1] - pair[0]) as usize);
        let first = lengths.next().unwrap_or(0);
        ensure!(first > 1, "there are no episodes to learn from");
        ensure!(lengths.all(|length| length == first), "the episodes differ in length");
        Ok(first)
    }

    /// The episodes of several artifacts, in their order.
    ///
    /// # Errors
    /// The artifacts are of different tasks, or costs are observed in some only.
    pub fn concat(parts: &[Self]) -> anyhow::Result<Self> {
        let Some((first, rest)) = parts.split_first() else { return Ok(Self::default()) };
        let mut all = first.clone();
        for part in rest {
            ensure!(
                part.picture == all.picture && part.action_dim == all.action_dim && part.goals == all.goals,
                "trajectories of different tasks cannot be joined"
            );
            ensure!(part.costs.is_empty() == all.costs.is_empty(), "costs are observed in some trajectories only");
            let offset = *all.bounds.last().unwrap_or(&0);
            all.bounds.extend(part.bounds.iter().skip(1).map(|bound| bound + offset));
            all.observations.extend_from_slice(&part.observations);
            all.actions.extend_from_slice(&part.actions);
            all.costs.extend_from_slice(&part.costs);
            all.goal_index.extend_from_slice(&part.goal_index);
        }
        Ok(all)
    }
}

const FILE: &str = "trajectories.safetensors";

impl Artifact for Trajectories {
    const TYPE: &'static str = "trajectories";

    fn save(self) -> anyhow::Result<Files> {
        let (height, width) = self.picture;
        let count = self.actions.len() / self.action_dim;
        let goals = self.goals.len().checked_div(height * width).unwrap_or_default();
        let mut tensors = Tensors::default();
        tensors
            .u8("observations", &[count, height, width], self.observations)
            .f32("actions", &[count, self.action_dim], &self.actions)
            .f32("costs", &[self.costs.len()], &self.costs)
            .u8("goals", &[goals, height, width], self.goals)
            .u32("goal_index", &[self.goal_index.len()], &self.goal_index)
            .u32("bounds", &[self.bounds.len()], &self.bounds);
        Ok(Files::from([(FILE, tensors.content()?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let tensors = TensorFile::open(files, FILE)?;
        let shape = |name, dimensions| tensors.shape_of(name, dimensions);
        let (observations, actions, goals) = (shape("observations", 3)?, shape("actions", 2)?, shape("goals", 3)?);
        let (count, picture) = (observations[0], &observations[1..]);
        let pixels = picture[0].checked_mul(picture[1]).unwrap_or_default();
        ensure!(pixels > 0 && actions[1] > 0, "pictures or actions without numbers");
        ensure!(actions[0] == count && &goals[1..] == picture, "tensors of different lengths");
        let (costs, bounds, goal_index) = (tensors.f32("costs")?, tensors.u32("bounds")?, tensors.u32("goal_index")?);
        ensure!(costs.is_empty() || costs.len() == count, "{} costs of {count} steps", costs.len());
        let ends = bounds.first().copied().unwrap_or(0) == 0 && bounds.last().copied().unwrap_or(0) as usize == count;
        ensure!(
            ends && bounds.is_sorted() && bounds.len().saturating_sub(1) == goal_index.len(),
            "bounds of episodes that do not fit"
        );
        ensure!(goal_index.iter().all(|&goal| (goal as usize) < goals[0]), "a goal index without a goal image");
        Ok(Self {
            picture: (picture[0], picture[1]),
            action_dim: actions[1],
            bounds,
            observations: tensors.u8("observations")?,
            actions: tensors.f32("actions")?,
            costs,
            goals: tensors.u8("goals")?,
            goal_index,
        })
    }
}
