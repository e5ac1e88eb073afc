//! The contract of a simulator: what evaluation and the collection of data run.
//!
//! A simulator keeps its own state, so that it may live in another process. Telling and setting that state is optional.
//! What takes the equations of a task is in [`System`](super::System).

use super::Start;
use crate::num::rng::Rng;

/// The frames that make one observation. A byte is a number of a pixel, row by row. The channels of a frame follow each
/// other, each as a whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frames {
    /// Rows of pixels in a frame.
    pub height: usize,
    /// Columns of pixels in a frame.
    pub width: usize,
    /// Numbers of a pixel: 1 for grey, 3 for red, green and blue.
    pub channels: usize,
    /// Whether there are shades between black and white. Otherwise every byte is 0 or 255.
    pub shades: bool,
    /// Frames of an observation: 2 where a single frame does not show velocities.
    pub count: usize,
}

impl Frames {
    /// So many frames of black and white pixels.
    pub const fn black_and_white(height: usize, width: usize, count: usize) -> Self {
        Self { height, width, channels: 1, shades: false, count }
    }

    /// Rows and columns of an observation. Its frames are stacked, the older one on top, and so are their channels.
    pub fn observation(self) -> (usize, usize) {
        (self.count * self.channels * self.height, self.width)
    }

    /// Numbers of a frame, in all its channels.
    pub fn pixels(self) -> usize {
        self.channels * self.height * self.width
    }

    /// An observation as a picture to look at: rows, columns, and the bytes, where the channels of a pixel stand side by
    /// side.
    pub fn picture(self, observation: &[u8]) -> (usize, usize, Vec<u8>) {
        let plane = self.height * self.width;
        let of_frame = |frame| (0..plane).flat_map(move |at| (0..self.channels).map(move |c| frame + c * plane + at));
        let order = (0..self.count).flat_map(|frame| of_frame(frame * self.pixels()));
        (self.count * self.height, self.width, order.map(|at| observation[at]).collect())
    }
}

/// What is known of a task before it is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Spec {
    /// The frames of an observation.
    pub frames: Frames,
    /// Largest absolute value of each component of an action, in units of the task.
    pub action_limit: Vec<f64>,
    /// Control steps of an episode, T in the paper.
    pub horizon: usize,
    /// How many goals there are. An episode has one of them.
    pub goals: usize,
    /// Largest distance from a goal that counts as being there in the paper's protocol, in units of the state.
    pub goal_radius: f64,
}

impl Spec {
    /// Why no episode of the task could run; `None` where nothing stands in the way.
    pub fn mistake(&self) -> Option<&'static str> {
        let Self { frames, action_limit, horizon, goals, goal_radius } = self;
        let is_above_zero = |number: &f64| number.is_finite() && *number > 0.0;
        match () {
            () if frames.count * frames.pixels() == 0 => Some("its observations have no pixel"),
            () if action_limit.is_empty() => Some("its actions have no component"),
            () if !action_limit.iter().all(is_above_zero) => Some("an action limit is not above 0"),
            () if *horizon == 0 => Some("its episodes have no step"),
            () if *goals == 0 => Some("it has no goal"),
            () if !is_above_zero(goal_radius) => Some("the radius of its goals is not above 0"),
            () => None,
        }
    }
}

/// Where the simulated system is. It holds true states, so nothing that learns may read it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// The true state one control step ago, which the older frame shows; the state itself at the start of an episode.
    pub before: Vec<f64>,
    /// The true state.
    pub state: Vec<f64>,
}

impl Snapshot {
    /// A system at rest: both frames show the same state.
    pub fn at_rest(state: Vec<f64>) -> Self {
        Self { before: state.clone(), state }
    }
}

/// A running task. All randomness is drawn from the stream that the caller hands in.
pub trait Simulator: Send {
    /// Begins an episode towards the goal of this number.
    ///
    /// # Errors
    /// Whatever keeps the simulator from working.
    fn reset(&mut self, start: Start, goal: usize, rng: &mut Rng) -> anyhow::Result<()>;

    /// Applies an action for one control step. Its components are shares of the largest action; those beyond -1..1 are
    /// clipped.
    ///
    /// # Errors
    /// Whatever keeps the simulator from working.
    fn step(&mut self, action: &[f32], rng: &mut Rng) -> anyhow::Result<()>;

    /// The observation now: the pixels of its frames.
    fn observe(&self) -> Vec<u8>;

    /// The observation at rest at a goal.
    fn goal_image(&self, goal: usize) -> Vec<u8>;

    /// Whether the system is within `radius` of the episode's goal.
    fn is_at_goal(&self, radius: f64) -> bool;

    /// Where the system is; `None` from a simulator that cannot tell.
    fn snapshot(&self) -> Option<&Snapshot> {
        None
    }

    /// Continues an episode from a snapshot of it.
    ///
    /// # Errors
    /// If the simulator cannot be put into a given state.
    fn restore(&mut self, _: &Snapshot, _goal: usize) -> anyhow::Result<()> {
        anyhow::bail!("this simulator cannot be put into a given state")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::env::{Task, World, registry};

    #[test]
    fn the_channels_of_a_picture_to_look_at_stand_side_by_side() {
        let frames = Frames { height: 1, width: 2, channels: 3, shades: true, count: 2 };
        let observation = [1, 4, 2, 5, 3, 6, 11, 14, 12, 15, 13, 16];
        let picture = vec![1, 2, 3, 4, 5, 6, 11, 12, 13, 14, 15, 16];
        assert_eq!(frames.picture(&observation), (2, 2, picture));
        assert_eq!(Frames::black_and_white(1, 2, 2).picture(&[1, 2, 3, 4]), (2, 2, vec![1, 2, 3, 4]));
    }

    #[test]
    fn a_spec_under_which_no_episode_could_run_is_named() {
        let sound = Spec {
            frames: Frames::black_and_white(2, 3, 1),
            action_limit: vec![1.0],
            horizon: 1,
            goals: 1,
            goal_radius: 0.5,
        };
        assert_eq!(sound.mistake(), None);
        let blind = Frames { count: 0, ..sound.frames };
        for (spec, why) in [
            (Spec { frames: blind, ..sound.clone() }, "its observations have no pixel"),
            (Spec { action_limit: vec![], ..sound.clone() }, "its actions have no component"),
            (Spec { action_limit: vec![1.0, f64::NAN], ..sound.clone() }, "an action limit is not above 0"),
            (Spec { horizon: 0, ..sound.clone() }, "its episodes have no step"),
            (Spec { goals: 0, ..sound.clone() }, "it has no goal"),
            (Spec { goal_radius: 0.0, ..sound.clone() }, "the radius of its goals is not above 0"),
        ] {
            assert_eq!(spec.mistake(), Some(why));
        }
        // What a program says of itself has checks of its own.
        for kind in registry().iter().filter(|kind| !matches!(kind.world, World::Process)) {
            let task: Task = serde_json::from_value(serde_json::json!({ "env": kind.name })).unwrap();
            assert_eq!(task.spec().mistake(), None, "{}", kind.name);
        }
    }
}
