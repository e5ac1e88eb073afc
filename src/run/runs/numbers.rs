//! The numbers that runs have taken: one line of `numbers` for each, with the number, the id and a checksum of both. A
//! run takes its number under a lock, so no two runs have the same number. With this file, the order of runs is known
//! without reading each run.

use std::{
    collections::BTreeMap,
    fs::OpenOptions,
    io::{Read as _, Write as _},
    path::Path,
};

use anyhow::Context as _;

use super::list::{is_id, list_with};
use crate::{digest::Digest, failpoint::failpoint};

/// The file in the folder of the runs.
const FILE: &str = "numbers";

/// A number as large as this is damage. It would leave no number for the next run.
pub(super) const MOST: u64 = 1 << 53;

/// The numbers of runs by their ids. If a run is missing here, for example because it was copied from another folder,
/// its own files hold its number.
pub(super) type Numbers = BTreeMap<String, u64>;

/// The numbers that are written down. Lines that are damaged are left out.
pub(super) fn read(runs: &Path) -> Numbers {
    parse(&std::fs::read(runs.join(FILE)).unwrap_or_default())
}

/// Takes a number for a run: one above the highest of all runs before it.
pub(super) fn take(runs: &Path, id: &str) -> anyhow::Result<u64> {
    let path = runs.join(FILE);
    let cannot_take = || format!("cannot take a number from {}", path.display());
    let mut file = OpenOptions::new().read(true).append(true).create(true).open(&path).with_context(cannot_take)?;
    file.lock().with_context(cannot_take)?;
    let mut text = Vec::new();
    file.read_to_end(&mut text).with_context(cannot_take)?;
    let numbers = parse(&text);
    let newest = list_with(runs, &numbers)?.first().and_then(|newest| newest.number);
    let number = newest.max(numbers.values().copied().max()).unwrap_or(0) + 1;
    // If a full disk cut the last line short, this line break ends it.
    let ended = if text.last().is_some_and(|&byte| byte != b'\n') { "\n" } else { "" };
    let line = format!("{ended}{}\n", line(number, id));
    failpoint!("take number", file.write_all(line.as_bytes())).with_context(cannot_take)?;
    Ok(number)
}

/// A line without its line break. The checksum reveals a flipped digit, which would change the order of runs.
fn line(number: u64, id: &str) -> String {
    let text = format!("{number} {id}");
    let check = &Digest::of_bytes(text.as_bytes()).hex()[..8];
    format!("{text} {check}")
}

fn parse(text: &[u8]) -> Numbers {
    let read = |text: &str| {
        let mut words = text.split(' ');
        let (number, id) = (words.next()?.parse().ok()?, words.next()?);
        (number < MOST && is_id(id) && text == line(number, id)).then(|| (id.to_owned(), number))
    };
    text.split(|&byte| byte == b'\n').filter_map(|line| read(std::str::from_utf8(line).ok()?)).collect()
}
