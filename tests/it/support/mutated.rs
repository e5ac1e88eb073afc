//! Any bytes, and valid files with any change, for readers that must survive both. `tests/corpus` holds the files: a
//! reader takes those whose name begins with `whole`, and refuses the others.

use std::{
    fs,
    path::{Path, PathBuf},
};

use proptest::{collection::vec, prelude::*, sample::Index};

use crate::allocator::asked;

/// One change of a file.
#[derive(Debug, Clone)]
enum Change {
    Flip(Index, u8),
    Cut(Index),
    Extend(Vec<u8>),
    Delete(Index, usize),
    Double(Index, usize),
    Zero(Index, usize),
    /// A number of eight bytes, such as a length that no file has.
    Number(Index, u64),
}

fn change() -> impl Strategy<Value = Change> {
    let block = || (any::<Index>(), 1..64_usize);
    let number = prop_oneof![Just(1 << 63), Just(u64::MAX), Just(1 << 40), Just(u64::from(u32::MAX)), any::<u64>()];
    prop_oneof![
        (any::<Index>(), any::<u8>()).prop_map(|(at, bits)| Change::Flip(at, bits)),
        any::<Index>().prop_map(Change::Cut),
        vec(any::<u8>(), 1..64).prop_map(Change::Extend),
        block().prop_map(|(at, length)| Change::Delete(at, length)),
        block().prop_map(|(at, length)| Change::Double(at, length)),
        block().prop_map(|(at, length)| Change::Zero(at, length)),
        (any::<Index>(), number).prop_map(|(at, number)| Change::Number(at, number)),
    ]
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>) {
        let block = |at: &Index, length: usize| {
            let at = at.index(bytes.len() + 1);
            at..(at + length).min(bytes.len())
        };
        match self {
            Self::Flip(at, bits) => {
                let at = at.index(bytes.len().max(1));
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= bits;
                }
            }
            Self::Cut(at) => bytes.truncate(at.index(bytes.len() + 1)),
            Self::Extend(more) => bytes.extend(more),
            Self::Delete(at, length) => _ = bytes.drain(block(at, *length)),
            Self::Double(at, length) => {
                let block = block(at, *length);
                let copy = bytes[block.clone()].to_vec();
                bytes.splice(block.start..block.start, copy);
            }
            Self::Zero(at, length) => {
                let block = block(at, *length);
                bytes[block].fill(0);
            }
            Self::Number(at, number) => {
                let block = block(at, 8);
                let length = block.len();
                bytes[block].copy_from_slice(&number.to_le_bytes()[..length]);
            }
        }
    }
}

/// A few changes of one of several files.
#[derive(Debug, Clone)]
pub struct Mutation {
    file: Index,
    changes: Vec<Change>,
}

pub fn mutation() -> impl Strategy<Value = Mutation> {
    (any::<Index>(), vec(change(), 1..4)).prop_map(|(file, changes)| Mutation { file, changes })
}

impl Mutation {
    /// One of the items with the bytes of its file after the changes.
    pub fn of<'a, T>(&self, items: &'a [T], bytes: impl Fn(&T) -> Vec<u8>) -> (&'a T, Vec<u8>) {
        let item = &items[self.file.index(items.len())];
        let mut bytes = bytes(item);
        self.changes.iter().for_each(|change| change.apply(&mut bytes));
        (item, bytes)
    }

    /// A whole file of a kind in `tests/corpus`, and the same after the changes.
    pub fn of_corpus(&self, kind: &str) -> (Vec<u8>, Vec<u8>) {
        let files = whole(kind);
        let (whole, bytes) = self.of(&files, Vec::clone);
        (whole.clone(), bytes)
    }
}

/// Arbitrary bytes.
pub fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    vec(any::<u8>(), 0..400)
}

/// The files of a kind in `tests/corpus`, and whether each is whole.
pub fn corpus(kind: &str) -> Vec<(PathBuf, Vec<u8>, bool)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(kind);
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|item| item.unwrap().path()).collect();
    paths.sort();
    let is_whole = |path: &Path| path.file_name().unwrap().to_string_lossy().starts_with("whole");
    paths.into_iter().map(|path| (path.clone(), fs::read(&path).unwrap(), is_whole(&path))).collect()
}

/// The whole files of a kind in `tests/corpus`.
pub fn whole(kind: &str) -> Vec<Vec<u8>> {
    corpus(kind).into_iter().filter(|(_, _, is_whole)| *is_whole).map(|(_, bytes, _)| bytes).collect()
}

/// Reads `bytes` with `read`, which must not ask for much more memory at once than they take: a length in a file must not
/// decide over memory.
pub fn modestly<T>(bytes: &[u8], read: impl FnOnce(&[u8]) -> T) -> T {
    within((1 << 20) + 16 * bytes.len(), || read(bytes))
}

/// Does `work`, which must not ask for more than `most` bytes at once.
pub fn within<T>(most: usize, work: impl FnOnce() -> T) -> T {
    let mut result = None;
    let asked = asked(|| result = Some(work()));
    assert!(asked.largest <= most, "asked for {} bytes at once", asked.largest);
    result.expect("it is done")
}
