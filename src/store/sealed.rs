//! JSON files that show damage: their first line holds a digest of all lines that follow.

use serde::Serialize;

use crate::digest::Digest;

/// What the first line of a file says about the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seal {
    /// The lines are those that were written.
    Whole,
    /// The lines are others.
    Broken,
    /// The file has no digest.
    Absent,
}

/// The text of an object, sealed. The whole text is one JSON object with `check` as its first member.
pub(crate) fn seal(object: &impl Serialize) -> serde_json::Result<Vec<u8>> {
    // The first line takes the place of the brace and the line break with which the text begins.
    let head = head(Digest::of_bytes(&[])).len();
    let mut text = vec![0; head - OPEN.len()];
    serde_json::to_writer_pretty(&mut text, object)?;
    text.push(b'\n');
    let check = Digest::of_bytes(&text[head..]);
    text[..head].copy_from_slice(self::head(check).as_bytes());
    Ok(text)
}

/// A text whose first line, the beginning of a JSON object, is still missing.
pub(super) fn with_head(body: &str) -> String {
    format!("{}{body}", head(Digest::of_bytes(body.as_bytes())))
}

/// Compares the first line of a text with the others.
pub(crate) fn check(text: &[u8]) -> Seal {
    if !text.starts_with(BEGIN.as_bytes()) {
        return Seal::Absent;
    }
    let body = text.iter().position(|&byte| byte == b'\n').map_or(text.len(), |end| end + 1);
    let is_whole = text[..body] == *head(Digest::of_bytes(&text[body..])).as_bytes();
    if is_whole { Seal::Whole } else { Seal::Broken }
}

const BEGIN: &str = "{\"check\":\"";

/// How the pretty text of an object begins.
const OPEN: &str = "{\n";

fn head(check: Digest) -> String {
    format!("{BEGIN}{check}\",\n")
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn every_flipped_bit_breaks_the_seal_or_the_text() {
        let text = seal(&json!({"format": 2, "nodes": [{"key": "b3:07"}]})).unwrap();
        assert_eq!(check(&text), Seal::Whole);
        assert_eq!(serde_json::from_slice::<Value>(&text).unwrap()["nodes"][0]["key"], "b3:07");
        for at in 0..text.len() * 8 {
            let mut flipped = text.clone();
            flipped[at / 8] ^= 1 << (at % 8);
            assert_ne!(check(&flipped), Seal::Whole, "bit {at}");
        }
        (0..text.len()).for_each(|end| assert_ne!(check(&text[..end]), Seal::Whole, "cut at {end}"));
    }
}
