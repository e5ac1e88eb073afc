//! The messages between this process and an environment's: frames of bytes on its standard input and output.
//!
//! A frame is the length of the rest (u32), the kind of message (u8) and the body. Numbers are little-endian. Every
//! request has one reply. `docs/your-own-task.md` describes every message.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::env::{Frames, Spec};

/// The version of the messages.
pub const PROTOCOL: u64 = 1;
/// The most bytes of a frame.
pub const LONGEST_FRAME: usize = 1 << 28;
/// The most numbers of an observation.
const MOST_NUMBERS: usize = 1 << 22;

/// What the first byte after the length says.
mod kind {
    pub(super) const HELLO: u8 = 1;
    pub(super) const RESET: u8 = 2;
    pub(super) const STEP: u8 = 3;
    pub(super) const SEEN: u8 = 4;
    pub(super) const ERROR: u8 = 5;
}

/// What an environment says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Rows of pixels in a picture.
    pub height: usize,
    /// Columns of pixels in a picture.
    pub width: usize,
    /// Numbers of a pixel: 1 for grey, 3 for red, green and blue.
    pub channels: usize,
    /// Whether there are shades. Otherwise every byte of a picture is 0 or 255.
    pub shades: bool,
    /// Pictures of an observation, each a control step after the one before.
    pub frames: usize,
    /// Smallest value of each component of an action.
    pub action_low: Vec<f64>,
    /// Largest value of each component of an action.
    pub action_high: Vec<f64>,
    /// Control steps of an episode.
    pub horizon: usize,
    /// How many goals there are.
    pub goals: usize,
    /// Numbers of a true state; 0 where the environment tells none.
    pub states: usize,
}

impl About {
    /// Bytes of a picture.
    pub fn picture(&self) -> usize {
        self.height * self.width * self.channels
    }

    /// Why no task can have these values.
    pub fn mistake(&self) -> Option<String> {
        let Self { height, width, channels, shades: _, frames, action_low, action_high, horizon, goals, states } = self;
        let within = |name: &str, value: usize, low: usize, high: usize| {
            (!(low..=high).contains(&value)).then(|| format!("`{name}` must lie in {low}..{high}, but is {value}"))
        };
        let is_range = |(low, high): (&f64, &f64)| low.is_finite() && high.is_finite() && low < high;
        let of_actions = match () {
            () if action_low.len() != action_high.len() => Some("`action_low` and `action_high` differ in length"),
            () if !action_low.iter().zip(action_high).all(is_range) => Some("an action has no finite limits"),
            () => None,
        };
        None.or_else(|| within("height", *height, 1, 4096))
            .or_else(|| within("width", *width, 1, 4096))
            .or_else(|| {
                (*channels != 1 && *channels != 3).then(|| format!("`channels` must be 1 or 3, but is {channels}"))
            })
            .or_else(|| within("frames", *frames, 1, 16))
            .or_else(|| within("the number of components of an action", action_low.len(), 1, 256))
            .or_else(|| of_actions.map(str::to_owned))
            .or_else(|| within("horizon", *horizon, 1, 1_000_000))
            .or_else(|| within("goals", *goals, 1, 4096))
            .or_else(|| within("states", *states, 0, 4096))
            .or_else(|| within("the numbers of an observation", frames * self.picture(), 1, MOST_NUMBERS))
    }

    /// Refuses shades in pictures that should have none.
    fn must_have_its_shades(&self, pictures: &[u8]) -> anyhow::Result<()> {
        let shade = pictures.iter().find(|byte| !self.shades && !matches!(byte, 0 | 255));
        shade.map_or(Ok(()), |shade| anyhow::bail!("a picture without `shades` has a pixel of {shade}"))
    }

    /// What the stages are told.
    pub fn spec(&self) -> Spec {
        let half = |(low, high): (&f64, &f64)| (high - low) / 2.0;
        Spec {
            frames: Frames {
                height: self.height,
                width: self.width,
                channels: self.channels,
                shades: self.shades,
                count: self.frames,
            },
            action_limit: self.action_low.iter().zip(&self.action_high).map(half).collect(),
            horizon: self.horizon,
            goals: self.goals,
            // The environment itself says whether it is at its goal.
            goal_radius: 1.0,
        }
    }

    /// The action that shares of the limits stand for, in units of the environment.
    pub fn action(&self, shares: &[f32]) -> Vec<f64> {
        let limits = self.action_low.iter().zip(&self.action_high);
        let action = |(&share, (low, high)): (&f32, (&f64, &f64))| {
            (low + high) / 2.0 + f64::from(share.clamp(-1.0, 1.0)) * ((high - low) / 2.0)
        };
        shares.iter().zip(limits).map(action).collect()
    }
}

/// A request to begin an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reset {
    /// Which of the environments in the process.
    pub env: u32,
    /// The seed of all that is random in the episode.
    pub seed: u64,
    /// Which of the goals.
    pub goal: u32,
}

/// A request to make a control step.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Which of the environments in the process.
    pub env: u32,
    /// The action, in units of the environment.
    pub action: Vec<f64>,
}

/// What an environment shows after a reset or a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Which of the environments in the process.
    pub env: u32,
    /// Whether it stands at the goal of its episode.
    pub is_at_goal: bool,
    /// The true state; empty where the environment tells none.
    pub state: Vec<f64>,
    /// The picture, row by row; the channels of a pixel stand side by side.
    pub picture: Vec<u8>,
}

/// The answer to a hello.
#[derive(Debug, Clone, PartialEq)]
pub struct Welcome {
    /// What the environment says of itself.
    pub about: About,
    /// The picture of every goal.
    pub goals: Vec<Vec<u8>>,
}

/// A frame with its length.
fn frame(kind: u8, body: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(5 + body.len());
    frame.extend((body.len() as u32 + 1).to_le_bytes());
    frame.push(kind);
    frame.extend(body);
    frame
}

/// The first request: the options of the task.
pub fn hello(options: &Map<String, Value>) -> Vec<u8> {
    let text = json!({ "protocol": PROTOCOL, "options": options }).to_string();
    frame(kind::HELLO, text.as_bytes())
}

/// The request to begin episodes.
pub fn reset(resets: &[Reset]) -> Vec<u8> {
    let mut body = (resets.len() as u32).to_le_bytes().to_vec();
    for Reset { env, seed, goal } in resets {
        body.extend(env.to_le_bytes());
        body.extend(seed.to_le_bytes());
        body.extend(goal.to_le_bytes());
    }
    frame(kind::RESET, &body)
}

/// The request to make control steps.
pub fn step(steps: &[Step]) -> Vec<u8> {
    let mut body = (steps.len() as u32).to_le_bytes().to_vec();
    for Step { env, action } in steps {
        body.extend(env.to_le_bytes());
        action.iter().for_each(|number| body.extend(number.to_le_bytes()));
    }
    frame(kind::STEP, &body)
}

/// Reads the answer to a hello, without its length.
///
/// # Errors
/// What is wrong with it.
pub fn welcome(frame: &[u8]) -> anyhow::Result<Welcome> {
    let mut rest = Rest(body(frame, kind::HELLO)?);
    let length = rest.u32()? as usize;
    let text = rest.bytes(length)?;
    let mut told: Map<String, Value> = serde_json::from_slice(text).map_err(|_| garbage())?;
    let protocol = told.remove("protocol");
    if protocol != Some(PROTOCOL.into()) {
        let protocol = protocol.map_or_else(|| "no version".to_owned(), |version| format!("version {version}"));
        anyhow::bail!(
            "the environment speaks {protocol} of the protocol, this carl-pipe speaks version {PROTOCOL}: install the \
             `carl_env` that comes with it"
        );
    }
    let about: About = serde_json::from_value(Value::Object(told))
        .map_err(|error| anyhow::anyhow!("the environment does not describe itself well: {error}"))?;
    if let Some(mistake) = about.mistake() {
        anyhow::bail!("the environment describes itself wrongly: {mistake}");
    }
    anyhow::ensure!(
        rest.0.len() == about.goals * about.picture(),
        "the environment sent {} bytes of goal pictures, but {} goals of {} x {} x {} are {}",
        rest.0.len(),
        about.goals,
        about.height,
        about.width,
        about.channels,
        about.goals * about.picture()
    );
    about.must_have_its_shades(rest.0)?;
    let goals = rest.0.chunks_exact(about.picture()).map(<[u8]>::to_vec).collect();
    Ok(Welcome { about, goals })
}

/// Reads the answer to a reset or a step of these environments, without its length.
///
/// # Errors
/// What is wrong with it.
pub fn seen(frame: &[u8], about: &About, envs: impl ExactSizeIterator<Item = u32>) -> anyhow::Result<Vec<Seen>> {
    let mut rest = Rest(body(frame, kind::SEEN)?);
    let each = 5 + 8 * about.states + about.picture();
    let (count, wanted) = (rest.u32()? as usize, envs.len());
    anyhow::ensure!(
        count == wanted && rest.0.len() == count * each,
        "the environment sent {} bytes for {count} environments, but {wanted} with a picture of {} x {} x {} and {} \
         numbers of state take {}: a picture or a state has another shape than it said at the start",
        rest.0.len(),
        about.height,
        about.width,
        about.channels,
        about.states,
        wanted * each
    );
    envs.map(|env| rest.seen(env, about)).collect()
}

/// The body of a frame of this kind.
fn body(frame: &[u8], wanted: u8) -> anyhow::Result<&[u8]> {
    match frame {
        [kind, body @ ..] if *kind == wanted => Ok(body),
        [kind::ERROR, text @ ..] => {
            Err(anyhow::anyhow!("the environment failed: {}", String::from_utf8_lossy(text).trim()))
        }
        _ => Err(garbage()),
    }
}

/// The error for bytes that are no message.
pub fn garbage() -> anyhow::Error {
    anyhow::anyhow!(
        "the environment sent something that is no message of the protocol: does it print to standard output?"
    )
}

/// The bytes of a message that are not read yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn bytes(&mut self, count: usize) -> anyhow::Result<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count).ok_or_else(garbage)?;
        self.0 = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> anyhow::Result<[u8; N]> {
        self.bytes(N)?.try_into().map_err(|_| garbage())
    }

    fn u32(&mut self) -> anyhow::Result<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn seen(&mut self, env: u32, about: &About) -> anyhow::Result<Seen> {
        let number = self.u32()?;
        anyhow::ensure!(number == env, "the environment answered for number {number} in place of {env}");
        let [is_at_goal] = self.array()?;
        let numbers = self.bytes(8 * about.states)?.as_chunks::<8>().0.iter();
        let state: Vec<f64> = numbers.map(|&bytes| f64::from_le_bytes(bytes)).collect();
        if let Some(bad) = state.iter().find(|number| !number.is_finite()) {
            anyhow::bail!("the environment's true state holds {bad}");
        }
        let picture = self.bytes(about.picture())?.to_vec();
        about.must_have_its_shades(&picture)?;
        Ok(Seen { env, is_at_goal: is_at_goal != 0, state, picture })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;
    use crate::num::rng::Rng;

    fn about() -> About {
        About {
            height: 2,
            width: 3,
            channels: 1,
            shades: true,
            frames: 2,
            action_low: vec![-2.0, 0.0],
            action_high: vec![2.0, 1.0],
            horizon: 9,
            goals: 1,
            states: 1,
        }
    }

    fn welcome_bytes(text: &str, pictures: &[u8]) -> Vec<u8> {
        let mut bytes = vec![kind::HELLO];
        bytes.extend((text.len() as u32).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(pictures);
        bytes
    }

    fn text(protocol: u64, about: &About) -> String {
        let mut told = serde_json::to_value(about).unwrap();
        told["protocol"] = protocol.into();
        told.to_string()
    }

    fn seen_bytes(env: u32, state: f64) -> Vec<u8> {
        let mut bytes = vec![kind::SEEN, 1, 0, 0, 0];
        bytes.extend(env.to_le_bytes());
        bytes.push(1);
        bytes.extend(state.to_le_bytes());
        bytes.extend([7; 6]);
        bytes
    }

    #[test]
    fn whole_messages_are_read() {
        let got = welcome(&welcome_bytes(&text(1, &about()), &[9; 6])).unwrap();
        assert_eq!(got, Welcome { about: about(), goals: vec![vec![9; 6]] });
        let got = seen(&seen_bytes(4, 0.5), &about(), [4].into_iter()).unwrap();
        assert_eq!(got, [Seen { env: 4, is_at_goal: true, state: vec![0.5], picture: vec![7; 6] }]);
    }

    #[test]
    fn what_is_wrong_is_said() {
        let error = |result: anyhow::Result<Welcome>| result.unwrap_err().to_string();
        let of = |text: &str| error(welcome(&welcome_bytes(text, &[9; 6])));
        assert!(of(&text(2, &about())).starts_with("the environment speaks version 2 of the protocol"));
        assert!(of("{}").starts_with("the environment speaks no version"));
        assert!(of("hello").contains("print to standard output"));
        assert!(of(&text(1, &About { channels: 2, ..about() })).contains("`channels` must be 1 or 3, but is 2"));
        assert!(of(&text(1, &About { goals: 2, ..about() })).contains("6 bytes of goal pictures"));
        let unlimited = About { action_high: vec![2.0, 0.0], ..about() };
        assert!(of(&text(1, &unlimited)).contains("an action has no finite limits"));
        let error = |bytes: &[u8]| seen(bytes, &about(), [4].into_iter()).unwrap_err().to_string();
        assert!(error(&seen_bytes(5, 0.5)).contains("answered for number 5 in place of 4"));
        assert!(error(&seen_bytes(4, f64::NAN)).contains("true state holds NaN"));
        assert!(error(&seen_bytes(4, 0.5)[..20]).contains("another shape"));
        let black_and_white = About { shades: false, ..about() };
        let error_of = seen(&seen_bytes(4, 0.5), &black_and_white, [4].into_iter()).unwrap_err().to_string();
        assert_eq!(error_of, "a picture without `shades` has a pixel of 7");
        assert_eq!(error(b"\x05no door"), "the environment failed: no door");
    }

    #[test]
    fn actions_are_shares_of_the_limits() {
        assert_eq!(about().action(&[0.5, 0.5]), [1.0, 0.75]);
        assert_eq!(about().action(&[-9.0, -1.0]), [-2.0, 0.0]);
    }

    /// Frames of random bytes, and whole frames with a few changed bytes.
    #[test]
    fn ten_thousand_random_frames_never_panic() {
        let mut rng = Rng::seed_from_u64(16);
        let whole = [welcome_bytes(&text(1, &about()), &[9; 6]), seen_bytes(4, 0.5)];
        for round in 0..10_000_usize {
            let mut bytes: Vec<u8> = match round % 3 {
                0 => (0..rng.random_range(0..64)).map(|_| rng.random()).collect(),
                kind => whole[kind - 1].clone(),
            };
            for _ in 0..rng.random_range(0..4) {
                let at = rng.random_range(0..=bytes.len());
                match rng.random_range(0..3) {
                    0 => bytes.truncate(at),
                    1 => bytes.insert(at, rng.random()),
                    _ => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = rng.random()),
                }
            }
            if let Ok(Welcome { about, goals }) = welcome(&bytes) {
                assert_eq!((about.mistake(), goals.len()), (None, about.goals));
            }
            for seen in seen(&bytes, &about(), [4].into_iter()).into_iter().flatten() {
                assert_eq!((seen.state.len(), seen.picture.len()), (1, 6));
            }
        }
    }
}
