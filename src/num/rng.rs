//! Named random streams: every draw comes from (seed, stage kind, round, stream, purpose), so that adding a draw in one
//! place shifts none in another and renaming a stage changes nothing.

use rand::{SeedableRng as _, rngs::ChaCha12Rng};
use serde::{Deserialize, Serialize};

/// The generator behind every draw; portable by contract of the `rand` crate.
pub type Rng = ChaCha12Rng;

/// What a stream is drawn for: a word, and a number where it recurs (`("batches", epoch)`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Purpose(&'static str, u64);

impl From<&'static str> for Purpose {
    fn from(word: &'static str) -> Self {
        Self(word, 0)
    }
}

impl From<(&'static str, u64)> for Purpose {
    fn from((word, number): (&'static str, u64)) -> Self {
        Self(word, number)
    }
}

/// The randomness of one node.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stream {
    /// The seed of the pipeline.
    pub seed: u64,
    /// The kind of stage.
    pub kind: String,
    /// The round of the loop; 0 outside of one.
    pub round: u32,
    /// Tells two stages of one kind apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stream: Option<String>,
}

impl Stream {
    /// The generator of this node for one purpose.
    pub fn rng(&self, purpose: Purpose) -> Rng {
        named(self.seed, &self.kind, self.round, self.stream.as_deref().unwrap_or(""), purpose)
    }

    /// A generator that depends on the seed and the purpose alone.
    pub fn shared(&self, purpose: Purpose) -> Rng {
        named(self.seed, "", 0, "", purpose)
    }
}

/// The exact position of a generator in its stream, as it lies on disk.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    /// The key of the generator.
    seed: [u8; 32],
    /// Words of 32 bits drawn so far.
    word: u64,
}

impl Position {
    /// Where `rng` stands.
    pub fn of(rng: &Rng) -> Self {
        // 2^64 words are never drawn.
        Self { seed: rng.get_seed(), word: rng.get_word_pos() as u64 }
    }

    /// A generator that stands there.
    pub fn rng(&self) -> Rng {
        let mut rng = Rng::from_seed(self.seed);
        rng.set_word_pos(u128::from(self.word));
        rng
    }
}

fn named(seed: u64, kind: &str, round: u32, stream: &str, Purpose(word, number): Purpose) -> Rng {
    let mut hasher = blake3::Hasher::new_derive_key("carl-pipe random stream v1");
    hasher.update(&seed.to_le_bytes()).update(&round.to_le_bytes()).update(&number.to_le_bytes());
    for part in [kind, stream, word] {
        hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
    }
    Rng::from_seed(*hasher.finalize().as_bytes())
}

#[cfg(test)]
mod tests {
    use rand::RngExt as _;

    use super::*;

    #[test]
    fn a_generator_goes_on_from_its_written_position() {
        for draws in 0..300 {
            let mut rng = Rng::from_seed([3; 32]);
            // Draws of one word and of two, so that every place in the generator's block comes up.
            for draw in 0..draws {
                if draw % 3 == 0 { _ = rng.random::<u64>() } else { _ = rng.random::<u32>() }
            }
            let written = serde_json::to_string(&Position::of(&rng)).expect("JSON");
            let mut other = serde_json::from_str::<Position>(&written).expect("a position").rng();
            assert_eq!(other.random::<[u32; 40]>(), rng.random::<[u32; 40]>(), "after {draws} draws");
        }
    }
}
