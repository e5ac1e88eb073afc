//! Digests of bytes with blake3. Equal digests mean equal bytes.

use std::{
    fmt,
    fs::{self, File},
    io,
    path::Path,
    str::FromStr,
};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use serde_json::Value;

/// A blake3 digest, written `b3:` and 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of bytes.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The digest of bytes in parts that follow each other.
    pub fn of_parts(parts: &[impl AsRef<[u8]>]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher.update(part.as_ref());
        }
        Self(*hasher.finalize().as_bytes())
    }

    /// The digest of all bytes that a reader gives.
    ///
    /// # Errors
    /// The reader failed.
    pub fn of_reader(reader: impl io::Read) -> io::Result<Self> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(reader)?;
        Ok(Self(*hasher.finalize().as_bytes()))
    }

    /// The digest of a file, or of all files below a folder with their names.
    ///
    /// # Errors
    /// Something cannot be read.
    pub fn of_path(path: &Path) -> io::Result<Self> {
        if !path.is_dir() {
            return File::open(path).and_then(Self::of_reader);
        }
        let mut files = Vec::new();
        for item in fs::read_dir(path)? {
            let item = item?;
            files.push((item.file_name().to_string_lossy().into_owned(), Self::of_path(&item.path())?));
        }
        Ok(Self::of_files(files.iter().map(|(name, digest)| (name.as_str(), *digest))))
    }

    /// The digest of a JSON value. The order of its keys does not matter.
    pub fn of_json(value: &Value) -> Self {
        let mut text = Vec::new();
        write_canonical(value, &mut text);
        Self::of_bytes(&text)
    }

    /// What [`Digest::of_json`] gives for an object with these members.
    pub fn of_members<'a>(members: impl IntoIterator<Item = (&'a str, &'a Value)>) -> Self {
        let mut text = Vec::new();
        write_object(members, &mut text);
        Self::of_bytes(&text)
    }

    /// The content digest of an artifact: a hash over the names and digests of its files, in the order of the names.
    pub fn of_files<'a>(files: impl IntoIterator<Item = (&'a str, Digest)>) -> Self {
        let mut files: Vec<_> = files.into_iter().collect();
        files.sort();
        let mut hasher = blake3::Hasher::new_derive_key("carl-pipe artifact v1");
        for (name, digest) in files {
            hasher.update(&(name.len() as u64).to_le_bytes()).update(name.as_bytes()).update(&digest.0);
        }
        Self(*hasher.finalize().as_bytes())
    }

    /// The 64 hexadecimal digits.
    pub fn hex(&self) -> String {
        self.blake3().to_hex().to_string()
    }

    fn blake3(&self) -> blake3::Hash {
        blake3::Hash::from_bytes(self.0)
    }

    /// `b3:` and the first ten digits, for people.
    pub fn short(&self) -> String {
        format!("b3:{}", &self.hex()[..10])
    }
}

impl From<[u8; 32]> for Digest {
    fn from(blake3: [u8; 32]) -> Self {
        Self(blake3)
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "b3:{}", self.blake3().to_hex())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.short())
    }
}

/// The text is not a digest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a digest is `b3:` and 64 hexadecimal digits")]
pub struct NotADigest;

impl FromStr for Digest {
    type Err = NotADigest;

    fn from_str(text: &str) -> Result<Self, NotADigest> {
        let hex = text.strip_prefix("b3:").ok_or(NotADigest)?;
        blake3::Hash::from_hex(hex).map(|hash| Self(*hash.as_bytes())).map_err(|_| NotADigest)
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
        text.parse().map_err(D::Error::custom)
    }
}

/// The canonical text of a JSON value: keys sorted, no spaces.
pub fn canonical(value: &Value) -> String {
    let mut text = Vec::new();
    write_canonical(value, &mut text);
    String::from_utf8(text).expect("JSON is text")
}

fn write_canonical(value: &Value, text: &mut Vec<u8>) {
    match value {
        Value::Object(members) => write_object(members.iter().map(|(name, value)| (name.as_str(), value)), text),
        Value::Array(items) => {
            text.push(b'[');
            for (i, item) in items.iter().enumerate() {
                if i > 0 {
                    text.push(b',');
                }
                write_canonical(item, text);
            }
            text.push(b']');
        }
        plain => write_plain(plain, text),
    }
}

fn write_object<'a>(members: impl IntoIterator<Item = (&'a str, &'a Value)>, text: &mut Vec<u8>) {
    let mut members: Vec<(&str, &Value)> = members.into_iter().collect();
    members.sort_unstable_by_key(|(name, _)| *name);
    text.push(b'{');
    for (i, (name, value)) in members.into_iter().enumerate() {
        if i > 0 {
            text.push(b',');
        }
        write_plain(name, text);
        text.push(b':');
        write_canonical(value, text);
    }
    text.push(b'}');
}

/// Writes a name, or a value that holds no others.
fn write_plain(value: &(impl Serialize + ?Sized), text: &mut Vec<u8>) {
    serde_json::to_writer(text, value).expect("a vector takes all bytes");
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_order_of_keys_does_not_matter() {
        let a = json!({"b": [1, {"d": 2.5, "c": "x"}], "a": null});
        let b: Value = serde_json::from_str(r#"{"a":null,"b":[1,{"c":"x","d":2.5}]}"#).unwrap();
        assert_eq!(canonical(&a), r#"{"a":null,"b":[1,{"c":"x","d":2.5}]}"#);
        assert_eq!(Digest::of_json(&a), Digest::of_json(&b));
        let members = b.as_object().unwrap().iter().rev().map(|(name, value)| (name.as_str(), value));
        assert_eq!(Digest::of_members(members), Digest::of_json(&a));
    }

    #[test]
    fn a_digest_survives_its_text() {
        let digest = Digest::of_bytes(b"carl");
        assert_eq!(digest.to_string().parse(), Ok(digest));
        assert_eq!("b3:12".parse::<Digest>(), Err(NotADigest));
        assert_eq!(digest.short().len(), 13);
    }

    #[test]
    fn the_digest_of_files_depends_on_names_but_not_on_order() {
        let (a, b) = (Digest::of_bytes(b"a"), Digest::of_bytes(b"b"));
        assert_eq!(Digest::of_files([("x", a), ("y", b)]), Digest::of_files([("y", b), ("x", a)]));
        assert_ne!(Digest::of_files([("x", a), ("y", b)]), Digest::of_files([("x", b), ("y", a)]));
        assert_ne!(Digest::of_files([("x", a)]), Digest::of_files([("y", a)]));
    }
}
