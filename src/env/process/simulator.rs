//! One environment of a process as a simulator. It stacks the pictures that an observation takes.

use rand::RngExt as _;

use super::{
    connection::Connection,
    program::Program,
    wire::{About, Reset, Seen, Step},
};
use crate::{
    env::{Simulator, Snapshot, Start},
    num::rng::Rng,
};

/// The number of the only environment in a process.
const ENV: u32 = 0;

/// An environment, with the pictures and the states that it showed last.
struct Environment {
    connection: Connection,
    /// The observation now: the pictures of its frames, the oldest first.
    observation: Vec<u8>,
    is_at_goal: bool,
    /// `None` where the environment tells no states.
    now: Option<Snapshot>,
}

/// Starts the environment of a program. It stands at its first goal until the first reset.
///
/// # Errors
/// The program does not start, or it is not the one that was described when the pipeline was read.
pub(in crate::env) fn open(program: &Program) -> anyhow::Result<Box<dyn Simulator>> {
    program.must_be_unchanged()?;
    let connection = Connection::open(program, program.log())?;
    program.must_match(connection.about())?;
    let observation = repeated(&planar(connection.goal(0), connection.about()), connection.about());
    Ok(Box::new(Environment { connection, observation, is_at_goal: true, now: None }))
}

/// The channels of a picture one after the other, each row by row.
fn planar(picture: &[u8], about: &About) -> Vec<u8> {
    let channel = |channel: usize| picture.iter().skip(channel).step_by(about.channels).copied();
    (0..about.channels).flat_map(channel).collect()
}

/// An observation at rest: every frame shows the same picture.
fn repeated(picture: &[u8], about: &About) -> Vec<u8> {
    picture.repeat(about.frames)
}

impl Environment {
    /// The one answer to a request for the one environment.
    fn only(seen: Vec<Seen>) -> anyhow::Result<Seen> {
        <[Seen; 1]>::try_from(seen).map(|[seen]| seen).map_err(|_| anyhow::anyhow!("not one answer"))
    }
}

impl Simulator for Environment {
    /// A fixed start has always the same seed. The other starts draw a seed.
    fn reset(&mut self, start: Start, goal: usize, rng: &mut Rng) -> anyhow::Result<()> {
        let seed = if start == Start::Fixed { 0 } else { u64::from(rng.random::<u32>()) };
        let seen = Self::only(self.connection.reset(&[Reset { env: ENV, seed, goal: goal as u32 }])?)?;
        let about = self.connection.about();
        self.observation = repeated(&planar(&seen.picture, about), about);
        self.is_at_goal = seen.is_at_goal;
        self.now = (about.states > 0).then(|| Snapshot::at_rest(seen.state));
        Ok(())
    }

    fn step(&mut self, action: &[f32], _: &mut Rng) -> anyhow::Result<()> {
        let action = self.connection.about().action(action);
        let seen = Self::only(self.connection.step(&[Step { env: ENV, action }])?)?;
        let picture = planar(&seen.picture, self.connection.about());
        self.observation.drain(..picture.len());
        self.observation.extend(picture);
        self.is_at_goal = seen.is_at_goal;
        if let Some(now) = &mut self.now {
            now.before = std::mem::replace(&mut now.state, seen.state);
        }
        Ok(())
    }

    fn observe(&self) -> Vec<u8> {
        self.observation.clone()
    }

    fn goal_image(&self, goal: usize) -> Vec<u8> {
        let about = self.connection.about();
        repeated(&planar(self.connection.goal(goal), about), about)
    }

    /// The environment itself decides; the radius means nothing.
    fn is_at_goal(&self, _: f64) -> bool {
        self.is_at_goal
    }

    fn snapshot(&self) -> Option<&Snapshot> {
        self.now.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_channels_of_a_picture_follow_each_other() {
        let about = About {
            height: 1,
            width: 2,
            channels: 3,
            shades: true,
            frames: 2,
            action_low: vec![-1.0],
            action_high: vec![1.0],
            horizon: 1,
            goals: 1,
            states: 0,
        };
        let picture = planar(&[1, 2, 3, 4, 5, 6], &about);
        assert_eq!(picture, [1, 4, 2, 5, 3, 6]);
        assert_eq!(repeated(&picture, &about), [1, 4, 2, 5, 3, 6, 1, 4, 2, 5, 3, 6]);
    }
}
