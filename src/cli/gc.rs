//! `carl-pipe gc`: deletes old runs and the results that no kept run uses.

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{run::gc::clean, store::LocalStore};

/// The arguments of `gc`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Keep the newest N runs and all results that they use.
    #[arg(long, value_name = "N", default_value_t = 10)]
    keep: usize,
    /// Only show what would be removed.
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Removes old runs and results. No run may be in progress.
pub(crate) fn gc(global: &Global, args: &Args) -> Result<Exit, Error> {
    let store = LocalStore::open_alone(&global.artifacts)?;
    let cleaned = clean(&store, &global.runs(), args.keep, args.dry_run)?;
    if args.json {
        out::json(&json!({"version": 1, "dry_run": args.dry_run, "removed": cleaned}));
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
