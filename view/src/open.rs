//! Opens runs and recordings as they are now, finished or not.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use carl_pipe::record::{self, NodeInfo, Polled, Reader};

use crate::{
    host::ViewHost,
    playback::Playback,
    run_view::RunView,
    timeline::{Lane, Timeline},
    viewer::Viewer,
};

/// Shows runs, folders of recordings, and single recordings.
///
/// # Errors
/// If nothing exists at a path, nothing can be shown, or the viewer is gone. A file that is no recording, or a damaged one,
/// is reported to the host, and the others are shown.
pub fn open(paths: &[PathBuf], viewer: &mut dyn Viewer, host: &dyn ViewHost) -> anyhow::Result<()> {
    if let Some(missing) = paths.iter().find(|path| !path.exists()) {
        bail!("there is no run or recording at {}", missing.display());
    }
    let (runs, others): (Vec<&PathBuf>, Vec<&PathBuf>) = paths.iter().partition(|path| is_run(path));
    for run_dir in &runs {
        let name = run_dir.file_name().unwrap_or_default().to_string_lossy();
        let prefix = if runs.len() > 1 { format!("{name}/") } else { String::new() };
        let mut run = RunView::new(run_dir, prefix, viewer, host);
        while run.show_new()? && !host.should_stop() {}
        if run.is_empty() && !host.should_stop() {
            bail!("{} holds no event that could be shown", run_dir.display());
        }
        run.close()?;
    }
    let (folders, files): (Vec<&PathBuf>, Vec<&PathBuf>) = others.into_iter().partition(|path| path.is_dir());
    let mut files: Vec<PathBuf> = files.into_iter().cloned().collect();
    for folder in folders {
        files.extend(recordings_in(folder)?);
    }
    show_files(&files, viewer, host)
}

fn is_run(path: &Path) -> bool {
    path.join("events.jsonl").exists()
}

fn recordings_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let cannot_read = || format!("cannot read {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(cannot_read)? {
        let path = entry.with_context(cannot_read)?.path();
        if path.extension().is_some_and(|extension| extension == "mcap") {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        bail!("{} holds neither `events.jsonl` nor recordings", folder.display());
    }
    Ok(files)
}

/// Shows recordings without a run around them, ordered by round and otherwise as given.
fn show_files(files: &[PathBuf], viewer: &mut dyn Viewer, host: &dyn ViewHost) -> anyhow::Result<()> {
    let is_fit = |file: &&PathBuf| match record::check(file) {
        Ok(()) => true,
        Err(why) => {
            host.note(&format!("cannot show {}: {why}", file.display()));
            false
        }
    };
    let fit: Vec<&PathBuf> = files.iter().filter(is_fit).collect();
    if fit.is_empty() && !files.is_empty() {
        bail!("none of {} files can be shown", files.len());
    }
    let mut nodes: Vec<(NodeInfo, &PathBuf)> = fit.into_iter().map(|file| (node_of(file), file)).collect();
    nodes.sort_by_key(|(node, _)| node.round);
    let mut timeline = Timeline::default();
    for (node, file) in nodes {
        let lane = Lane::of(&node.node);
        let start = timeline.start(&lane.branch);
        let mut playback = Playback::new(lane, "", node.round, start);
        playback.switch_to(file.clone());
        playback.show_rest(viewer, host)?;
        timeline.end(&playback.branch, playback.end);
    }
    Ok(())
}

/// The node that made a recording: by the recording's metadata, or else by the file's name.
fn node_of(file: &Path) -> NodeInfo {
    let from_metadata = || -> Option<NodeInfo> {
        let mut reader = Reader::open(file).ok()?;
        match reader.poll().ok()? {
            Polled::Metadata(_) => reader.node().cloned(),
            _ => None,
        }
    };
    let stem = || file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    from_metadata().unwrap_or_else(|| NodeInfo { node: stem(), ..NodeInfo::default() })
}
