//! Finds the pictures before and after each action.

use anyhow::ensure;

use super::pictures::Pictures;
use crate::arrays::Array;

/// What a file says about its steps.
pub(super) struct Pairs {
    pub(super) observations: Pictures,
    /// The pictures after the actions, where the file has them.
    pub(super) after: Option<Pictures>,
    /// Each is true at the last step of an episode.
    pub(super) ends: Vec<Array>,
    /// How many actions there are.
    pub(super) steps: usize,
}

/// The observations around an action.
#[derive(Debug)]
pub(super) struct Pair {
    /// The index of the action.
    pub(super) step: usize,
    pub(super) before: Vec<u8>,
    pub(super) after: Vec<u8>,
}

impl Pairs {
    /// The pairs in the order of the file. The last step of an episode has no picture after it, unless the file has
    /// pictures after the actions.
    pub(super) fn find(self) -> anyhow::Result<Vec<Pair>> {
        let Self { observations, after, ends, steps } = self;
        let count = observations.len();
        ensure!(
            count == steps || after.is_none() && count == steps + 1,
            "there are {count} observations and {steps} actions"
        );
        for end in &ends {
            let own = end.shape.iter().product::<usize>();
            ensure!(own == steps, "an array of ends has {own} numbers for {steps} actions");
        }
        let is_end: Vec<bool> = {
            let mut all = vec![false; steps];
            ends.iter()
                .for_each(|end| end.numbers().zip(&mut all).for_each(|(number, is_end)| *is_end |= number != 0.0));
            all
        };
        if let Some(after) = &after {
            ensure!(after.len() == steps, "there are {} next observations and {steps} actions", after.len());
            ensure!(
                observations.are_frames() == after.are_frames(),
                "observations and next observations have other frames"
            );
        }
        let (mut pairs, mut first) = (Vec::new(), 0);
        for step in 0..steps {
            let before = observations.observation(step, first)?;
            let next = match &after {
                Some(after) if after.are_frames() => {
                    let newest = after.picture(step);
                    Some([&before[newest.len()..], newest].concat())
                }
                Some(after) => Some(after.observation(step, step)?),
                None if is_end[step] || step + 1 == count => None,
                None => Some(observations.observation(step + 1, first)?),
            };
            if let Some(after) = next {
                pairs.push(Pair { step, before, after });
            }
            if is_end[step] {
                first = step + 1;
            }
        }
        Ok(pairs)
    }
}
