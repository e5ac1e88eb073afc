//! The symmetries of the task as data: copies of the transitions, changed at random.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Refusal, StageCx, within};
use crate::{
    artifact::Transitions,
    diag::instead,
    env::{Frames, SeenTransition, Symmetry, Task},
    lce::{LceModel, trainer::Data},
    num::{rng::Rng, sampling},
};

/// Symmetries of the task by name, each with the share of the transitions that it changes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Symmetries(BTreeMap<String, f64>);

impl Symmetries {
    /// Whether any symmetry has a share above 0.
    pub fn change_something(&self) -> bool {
        self.0.values().any(|&share| share > 0.0)
    }

    /// Refuses names that the task does not declare, and shares outside 0..1.
    pub(super) fn refusals(&self, task: &Task) -> Vec<Refusal> {
        let known = || task.kind.symmetries.iter().map(|symmetry| symmetry.name);
        let mut refusals = Vec::new();
        for (name, &share) in &self.0 {
            let path = format!("symmetries.{name}");
            if known().any(|known| known == name) {
                within(&mut refusals, path, share, 0.0, 1.0);
            } else {
                let help = instead(name, "symmetries", known());
                refusals
                    .push(Refusal::new(path, format!("is not a symmetry of the task `{}`", task.name())).help(help));
            }
        }
        refusals
    }

    /// The symmetries that change something, in the order in which the task declares them.
    fn of(&self, task: &Task) -> Vec<(&'static Symmetry, f64)> {
        let share = |symmetry: &Symmetry| self.0.get(symmetry.name).copied().filter(|&share| share > 0.0);
        task.kind.symmetries.iter().filter_map(|symmetry| Some((symmetry, share(symmetry)?))).collect()
    }
}

/// Copies of transitions. Each symmetry changes its share of each copy, independently of the other symmetries.
#[derive(Debug)]
pub struct SymmetricCopies<'a> {
    transitions: &'a Transitions,
    frames: Frames,
    symmetries: Vec<(&'static Symmetry, f64)>,
    count: usize,
    rng: Rng,
}

impl StageCx<'_> {
    /// `count` copies of the transitions with random changes, or the transitions themselves if no symmetry has a share
    /// above 0. Every call in a stage gives the same copies.
    pub fn symmetric_copies<'t>(
        &self,
        transitions: &'t Transitions,
        symmetries: &Symmetries,
        count: u64,
    ) -> SymmetricCopies<'t> {
        let symmetries = symmetries.of(self.task);
        let count = if symmetries.is_empty() { 1 } else { count as usize };
        let frames = self.task.spec().frames;
        SymmetricCopies { transitions, frames, symmetries, count, rng: self.rng("symmetries") }
    }
}

impl SymmetricCopies<'_> {
    /// Gives `take` the pictures of x and x' and the action of every transition of the first copy, then of the next
    /// copies.
    pub fn for_each(self, mut take: impl FnMut(&[u8], &[f32])) {
        let Self { transitions, frames, symmetries, count, mut rng } = self;
        let (pixels, components) = (transitions.pixels(), transitions.action_dim);
        let (mut pictures, mut action) = (vec![0; 2 * pixels], vec![0.0; components]);
        for i in (0..count).flat_map(|_| 0..transitions.len()) {
            pictures[..pixels].copy_from_slice(&transitions.observations[i * pixels..][..pixels]);
            pictures[pixels..].copy_from_slice(&transitions.next_observations[i * pixels..][..pixels]);
            action.copy_from_slice(&transitions.actions[i * components..][..components]);
            for (symmetry, share) in &symmetries {
                if f64::from(sampling::uniform(&mut rng, 0.0, 1.0)) < *share {
                    let mut seen = SeenTransition { pictures: &mut pictures, action: &mut action, frames };
                    (symmetry.apply)(&mut seen, &mut rng);
                }
            }
            take(&pictures, &action);
        }
    }

    /// The copies, packed for the training of `model`.
    pub fn data(self, model: &LceModel) -> Data {
        let (action_dim, copies) = (self.transitions.action_dim, self.count);
        let mut data = Data { images: model.pictures(&[]), actions: Vec::new(), action_dim, copies };
        self.for_each(|pictures, action| {
            data.images.extend(pictures);
            data.actions.extend_from_slice(action);
        });
        data
    }
}
