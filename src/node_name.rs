//! The name of a node: member of a suite, stage, round and point of the matrix.

use std::{fmt, num::ParseIntError, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

/// The name of a node, written `member/stage@round[axis=value,…]`. Every part but the stage may be missing.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeName {
    /// The member of a suite that the node belongs to.
    pub member: Option<String>,
    /// The stage, as its pipeline file names it.
    pub stage: String,
    /// The round of the loop.
    pub round: Option<u32>,
    /// The point of the matrix: axes and values, in the order of the axes.
    pub point: Vec<(String, String)>,
}

impl NodeName {
    /// `member/stage`, or `stage` outside of a suite: the name that all rounds and points share.
    pub fn stage_path(&self) -> String {
        match &self.member {
            Some(member) => format!("{member}/{}", self.stage),
            None => self.stage.clone(),
        }
    }

    /// `axis=value,…`, empty where no axis reaches the node.
    pub fn point_text(&self) -> String {
        let parts: Vec<String> = self.point.iter().map(|(axis, value)| format!("{axis}={value}")).collect();
        parts.join(",")
    }
}

/// Cuts `member/` off the name of a node or of a stage.
pub fn without_member(name: &str) -> &str {
    // A value in the point may hold a slash, such as a path.
    let head = name.find(['@', '[']).unwrap_or(name.len());
    name[..head].find('/').map_or(name, |slash| &name[slash + 1..])
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(member) = &self.member {
            write!(f, "{member}/")?;
        }
        f.write_str(&self.stage)?;
        if let Some(round) = self.round {
            write!(f, "@{round}")?;
        }
        if self.point.is_empty() { Ok(()) } else { write!(f, "[{}]", self.point_text()) }
    }
}

/// Why a text is not the name of a node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotANodeName {
    /// The stage is missing.
    #[error("`{0}` names no stage")]
    NoStage(String),
    /// The part after `@` is not a round.
    #[error("`{name}` names no round after `@`")]
    NoRound {
        /// The text.
        name: String,
        /// Why the round cannot be read.
        source: ParseIntError,
    },
    /// The point of the matrix is not written `[axis=value,…]`.
    #[error("`{0}` does not end in `[axis=value,…]`")]
    NoPoint(String),
}

impl FromStr for NodeName {
    type Err = NotANodeName;

    /// Reads a name; the round may also stand behind the point, as in `stage[seed=1]@3`.
    fn from_str(name: &str) -> Result<Self, NotANodeName> {
        let head = name.find(['@', '[']).unwrap_or(name.len());
        let (path, rest) = name.split_at(head);
        let (member, stage) = match path.split_once('/') {
            Some((member, stage)) => (Some(member.to_owned()), stage),
            None => (None, path),
        };
        if stage.is_empty() {
            return Err(NotANodeName::NoStage(name.to_owned()));
        }
        let (before, point, after) = match rest.split_once('[') {
            None => (rest, None, ""),
            Some((before, rest)) => match rest.rsplit_once(']') {
                Some((point, after)) => (before, Some(point), after),
                None => return Err(NotANodeName::NoPoint(name.to_owned())),
            },
        };
        let round = match before.strip_prefix('@').or_else(|| after.strip_prefix('@')) {
            None => None,
            Some(round) => {
                let round = round.parse();
                Some(round.map_err(|source| NotANodeName::NoRound { name: name.to_owned(), source })?)
            }
        };
        let point = point.map_or(Some(Vec::new()), read_point).ok_or_else(|| NotANodeName::NoPoint(name.to_owned()))?;
        Ok(Self { member, stage: stage.to_owned(), round, point })
    }
}

/// Reads `axis=value,…`. A part without `=` belongs to the value before it, since a value may hold commas.
fn read_point(text: &str) -> Option<Vec<(String, String)>> {
    let mut point: Vec<(String, String)> = Vec::new();
    for part in text.split(',') {
        match (part.split_once('='), point.last_mut()) {
            (Some((axis, value)), _) => point.push((axis.to_owned(), value.to_owned())),
            (None, Some((_, value))) => {
                value.push(',');
                value.push_str(part);
            }
            (None, None) => return None,
        }
    }
    Some(point)
}

impl Serialize for NodeName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for NodeName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
        text.parse().map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_survives_its_text() {
        for text in ["bootstrap", "represent@3", "a/represent@0[seed=1,task.noise=0.1]", "data[seed=2]"] {
            let name: NodeName = text.parse().unwrap();
            assert_eq!(name.to_string(), text);
        }
    }

    #[test]
    fn the_parts_of_a_name_are_told_apart() {
        let name: NodeName = "suite/represent@3[layers=[4,4],data=a/b]".parse().unwrap();
        let point = [("layers", "[4,4]"), ("data", "a/b")].map(|(axis, value)| (axis.to_owned(), value.to_owned()));
        let parts = (name.member.as_deref(), name.stage.as_str(), name.round, name.point.as_slice());
        assert_eq!(parts, (Some("suite"), "represent", Some(3), &point[..]));
        assert_eq!(name.stage_path(), "suite/represent");
    }

    #[test]
    fn a_round_behind_the_point_is_read() {
        let name: NodeName = "represent[seed=1]@3".parse().unwrap();
        assert_eq!(name.to_string(), "represent@3[seed=1]");
    }

    #[test]
    fn a_text_that_is_no_name_is_refused() {
        for text in ["", "a/", "@3", "a@", "a@x", "a[", "a[x]"] {
            assert!(text.parse::<NodeName>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_slash_in_a_value_is_not_a_member() {
        assert_eq!(without_member("suite/data[file=a/b]"), "data[file=a/b]");
        assert_eq!(without_member("data[file=a/b]"), "data[file=a/b]");
    }
}
