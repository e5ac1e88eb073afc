//! The MCAP options that all recordings share.

use std::io::Write;

use mcap::{WriteOptions, Writer, write::NoSeek};

/// Starts an MCAP file. Equal messages give equal bytes, because the options fix everything that could differ.
///
/// The writer does not seek. It writes each chunk whole, so a reader that follows the file never meets a length that is
/// filled in later.
pub(super) fn mcap_writer<W: Write>(file: W) -> mcap::McapResult<Writer<NoSeek<W>>> {
    let options = WriteOptions::new()
        .library("carl-pipe")
        .profile("")
        .compression(Some(mcap::Compression::Zstd))
        .compression_threads(1)
        .chunk_size(Some(1 << 20))
        .disable_seeking(true);
    options.create(NoSeek::new(file))
}
