//! Shows a run while it works, and runs and recordings that are finished: one way for all of them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context as _, bail};

use super::{
    At, Frame, Level, Message, NodeInfo, Place, Polled, Reader, Screen, Sink, Watcher,
    events::{Event, Events},
    playback::Playback,
    screen,
    story::Story,
};

const POLL_EVERY: Duration = Duration::from_millis(100);

/// Shows a run as it works, until it has finished or its process is gone.
///
/// # Errors
/// If the viewer cannot be reached or the run's events cannot be read; a recording that cannot be read is said and
/// passed over.
pub fn follow(run_dir: &Path, sink: &Sink, watcher: &dyn Watcher) -> anyhow::Result<()> {
    let mut screen = screen::open(sink, watcher)?;
    follow_on(run_dir, screen.as_mut(), watcher)?;
    screen.close(watcher)
}

/// Shows runs and recordings as they are now, finished or not.
///
/// # Errors
/// As [`follow`]; also if there is nothing at a path.
pub fn open(paths: &[PathBuf], sink: &Sink, watcher: &dyn Watcher) -> anyhow::Result<()> {
    if let Some(missing) = paths.iter().find(|path| !path.exists()) {
        bail!("there is no run or recording at {}", missing.display());
    }
    let mut screen = screen::open(sink, watcher)?;
    open_on(paths, screen.as_mut(), watcher)?;
    screen.close(watcher)
}

/// [`follow`] on any screen.
///
/// # Errors
/// As [`follow`].
pub fn follow_on(run_dir: &Path, screen: &mut dyn Screen, watcher: &dyn Watcher) -> anyhow::Result<()> {
    let mut run = Run::new(run_dir, String::new(), screen, watcher);
    while !run.over && !watcher.stop() {
        // Asked before reading: what a process wrote before it went is still read.
        let alive = watcher.alive();
        if !run.show_new()? {
            if !alive {
                break;
            }
            std::thread::sleep(POLL_EVERY);
        }
    }
    run.close()
}

/// [`open`] on any screen.
///
/// # Errors
/// As [`open`].
pub fn open_on(paths: &[PathBuf], screen: &mut dyn Screen, watcher: &dyn Watcher) -> anyhow::Result<()> {
    let (runs, mut files): (Vec<_>, Vec<_>) = paths.iter().partition(|path| path.join("events.jsonl").exists());
    for &run_dir in &runs {
        // Several runs side by side, each under its name.
        let name = run_dir.file_name().unwrap_or_default().to_string_lossy();
        let prefix = if runs.len() > 1 { format!("{name}/") } else { String::new() };
        let mut run = Run::new(run_dir, prefix, screen, watcher);
        while run.show_new()? && !watcher.stop() {}
        run.close()?;
    }
    let folders: Vec<PathBuf> = files.extract_if(.., |path| path.is_dir()).cloned().collect();
    let mut files: Vec<PathBuf> = files.into_iter().cloned().collect();
    for folder in folders {
        files.extend(recordings_in(&folder)?);
    }
    show_files(&files, screen, watcher)
}

fn recordings_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let cannot = || format!("cannot read {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let path = entry.with_context(cannot)?.path();
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

/// Recordings without a run around them: by round, then as given.
fn show_files(files: &[PathBuf], screen: &mut dyn Screen, watcher: &dyn Watcher) -> anyhow::Result<()> {
    let mut nodes: Vec<(NodeInfo, &PathBuf)> = files.iter().map(|path| (node_of(path), path)).collect();
    nodes.sort_by_key(|(node, _)| node.round);
    let mut story = Story::default();
    for (node, path) in nodes {
        let (_, point) = super::story::lane_and_point(&node.node);
        let mut playback = Playback::new(&node.node, "", node.round, story.start(&point));
        playback.switch_to(path.clone());
        playback.show_rest(screen, watcher)?;
        story.end(&playback.point, playback.end);
    }
    Ok(())
}

/// Whose recording this is, by its metadata or else by its name.
fn node_of(path: &Path) -> NodeInfo {
    let read = || -> Option<NodeInfo> {
        let mut reader = Reader::open(path).ok()?;
        match reader.poll().ok()? {
            Polled::Metadata(_) => reader.node().cloned(),
            _ => None,
        }
    };
    let stem = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    read().unwrap_or_else(|| NodeInfo { node: stem(), ..NodeInfo::default() })
}

/// A run on a screen.
struct Run<'a> {
    folder: &'a Path,
    prefix: String,
    screen: &'a mut dyn Screen,
    watcher: &'a dyn Watcher,
    events: Events,
    story: Story,
    working: BTreeMap<String, Playback>,
    finished: BTreeSet<String>,
    over: bool,
}

impl<'a> Run<'a> {
    fn new(folder: &'a Path, prefix: String, screen: &'a mut dyn Screen, watcher: &'a dyn Watcher) -> Run<'a> {
        let events = Events::of_run(folder);
        let (story, working, finished) = (Story::default(), BTreeMap::new(), BTreeSet::new());
        Run { folder, prefix, screen, watcher, events, story, working, finished, over: false }
    }

    /// Shows what happened since; true if there was something.
    fn show_new(&mut self) -> anyhow::Result<bool> {
        let mut moved = false;
        while let Some(event) = self.events.poll()? {
            moved = true;
            self.on(event)?;
        }
        for playback in self.working.values_mut() {
            moved |= playback.show_new(self.screen, self.watcher)?;
        }
        Ok(moved)
    }

    /// Shows what is left of nodes that never finished.
    fn close(mut self) -> anyhow::Result<()> {
        for playback in self.working.values_mut() {
            playback.show_rest(self.screen, self.watcher)?;
        }
        Ok(())
    }

    fn on(&mut self, event: Event) -> anyhow::Result<()> {
        match event {
            Event::RunStarted { pipeline, seed } => {
                let pipeline = pipeline.unwrap_or_else(|| "run".to_owned());
                let seed = seed.map(|seed| format!(" seed {seed}")).unwrap_or_default();
                self.screen.title(&format!("{pipeline}{seed}"))?;
            }
            Event::NodeStarted { node, round, recording } if !self.finished.contains(&node) => {
                // A node that starts again makes the same messages again.
                let recording = recording.map(|path| self.folder.join(path));
                let playback = self.playback(&node, round);
                recording.into_iter().for_each(|path| playback.switch_to(path));
                self.tell(&node, "started")?;
            }
            Event::NodeFinished { node, round, state, recording } if !self.finished.contains(&node) => {
                let recording = recording.map(|path| self.folder.join(path));
                let playback = self.playback(&node, round);
                recording.into_iter().for_each(|path| playback.switch_to(path));
                if let Some(mut playback) = self.working.remove(&node) {
                    playback.show_rest(self.screen, self.watcher)?;
                    self.story.end(&playback.point, playback.end);
                    let text = format!("{node} {}", state.as_deref().unwrap_or("finished"));
                    self.tell_at(playback.place(), text)?;
                }
                self.finished.insert(node);
            }
            Event::NodeStarted { .. } | Event::NodeFinished { .. } => {}
            Event::Metric { node, name, value } => {
                self.tell(&node.unwrap_or_default(), &format!("{name} = {value}"))?
            }
            Event::Say { node, text } => self.tell(&node.unwrap_or_default(), &text)?,
            Event::RunFinished {} => self.over = true,
        }
        Ok(())
    }

    fn playback(&mut self, node: &str, round: u32) -> &mut Playback {
        let (_, point) = super::story::lane_and_point(node);
        let start = self.story.start(&point);
        let prefix = &self.prefix;
        self.working.entry(node.to_owned()).or_insert_with(|| Playback::new(node, prefix, round, start))
    }

    /// An event about a node, as text among its messages.
    fn tell(&mut self, node: &str, text: &str) -> anyhow::Result<()> {
        let place = match self.working.get(node) {
            Some(playback) => playback.place(),
            None => Playback::new("run", &self.prefix, 0, self.story.start("")).place(),
        };
        let text = if node.is_empty() { text.to_owned() } else { format!("{node}: {text}") };
        self.tell_at(place, text)
    }

    fn tell_at(&mut self, place: Place, text: String) -> anyhow::Result<()> {
        let frame = Frame::Log { level: Level::Info, text };
        self.screen.show(&place, &Message { topic: "/log".to_owned(), at: At::default(), frame })
    }
}
