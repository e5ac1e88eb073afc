//! `carl-pipe gc`: removes what no kept run names.

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{run::gc::clean, store::LocalStore};

/// The arguments of `gc`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Keep the newest N runs and everything they name.
    #[arg(long, value_name = "N", default_value_t = 10)]
    keep: usize,
    /// Only say what would be removed.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

/// Cleans the store.
pub(crate) fn gc(global: &Global, args: &Args) -> Result<Exit, Error> {
    let store = LocalStore::open_alone(&global.artifacts)?;
    let cleaned = clean(&store, &global.runs(), args.keep, args.dry_run)?;
    if args.json {
        out::line(&serde_json::json!({"version": 1, "dry_run": args.dry_run, "removed": cleaned}).to_string());
        return Ok(Exit::Ok);
    }
    let word = if args.dry_run { "would remove" } else { "removed" };
    out::line(&format!(
        "{word} {} runs, {} results and {} objects: {}",
        cleaned.runs.len(),
        cleaned.entries,
        cleaned.objects,
        out::bytes(cleaned.bytes)
    ));
    Ok(Exit::Ok)
}
