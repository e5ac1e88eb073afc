//! The view of one run: takes the run's events in order and shows the recordings that they name.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use carl_pipe::{
    record::{At, Frame, Level, Message},
    run::{
        events::{Event, NodeState},
        recordings::Recordings,
    },
};

use crate::{
    event_log::EventLog,
    host::ViewHost,
    playback::Playback,
    timeline::{Lane, Timeline},
    viewer::{Position, Viewer},
};

/// The lane of texts that belong to no node.
const RUN_LANE: &str = "run";

/// A run in a viewer.
pub(crate) struct RunView<'a> {
    folder: &'a Path,
    /// Comes before the name of every lane; empty if the view shows one run.
    prefix: String,
    viewer: &'a mut dyn Viewer,
    host: &'a dyn ViewHost,
    events: EventLog,
    recordings: Recordings,
    timeline: Timeline,
    /// Nodes that have started and not finished.
    working: BTreeMap<String, Playback>,
    /// Nodes that have finished. A run that goes on names them again.
    finished: BTreeSet<String>,
    has_ended: bool,
    /// Whether no event was shown yet.
    is_empty: bool,
}

impl<'a> RunView<'a> {
    /// A run of which nothing was shown yet.
    pub(crate) fn new(folder: &'a Path, prefix: String, viewer: &'a mut dyn Viewer, host: &'a dyn ViewHost) -> Self {
        RunView {
            folder,
            prefix,
            viewer,
            host,
            events: EventLog::of_run(folder),
            recordings: Recordings::of_run(folder),
            timeline: Timeline::default(),
            working: BTreeMap::new(),
            finished: BTreeSet::new(),
            has_ended: false,
            is_empty: true,
        }
    }

    /// True once the run has written its last event.
    pub(crate) fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// True while no event was shown.
    pub(crate) fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// Shows what happened since the last call; true if something did.
    ///
    /// # Errors
    /// If the viewer is gone or the events cannot be read.
    pub(crate) fn show_new(&mut self) -> anyhow::Result<bool> {
        let mut is_new = false;
        while let Some(event) = self.events.poll()? {
            is_new = true;
            self.is_empty = false;
            self.on_event(event)?;
        }
        for playback in self.working.values_mut() {
            is_new |= playback.show_new(self.viewer, self.host)?;
        }
        Ok(is_new)
    }

    /// Shows the rest of the nodes that never finished.
    ///
    /// # Errors
    /// If the viewer is gone.
    pub(crate) fn close(mut self) -> anyhow::Result<()> {
        for playback in self.working.values_mut() {
            playback.show_rest(self.viewer, self.host)?;
        }
        Ok(())
    }

    fn on_event(&mut self, event: Event) -> anyhow::Result<()> {
        match event {
            Event::RunStarted { pipeline, seed, .. } => {
                let seed = seed.map(|seed| format!(" seed {seed}")).unwrap_or_default();
                self.viewer.title(&format!("{pipeline}{seed}"))
            }
            Event::NodeStarted { node, round, recording, .. } => self.on_node_started(&node, round, recording),
            Event::NodeFinished { node, round, state, recording, .. } => {
                self.on_node_finished(node, round, state, recording)
            }
            Event::Metric { node, name, value, .. } => self.show_text(&node, Level::Info, &format!("{name} = {value}")),
            Event::Say { node, text } => self.show_text(&node, Level::Info, &text),
            Event::Warning { node, text } => self.show_text(&node.unwrap_or_default(), Level::Warning, &text),
            Event::RunFinished { .. } => {
                self.has_ended = true;
                Ok(())
            }
            Event::Progress { .. } => Ok(()),
        }
    }

    fn on_node_started(&mut self, node: &str, round: Option<u32>, recording: Option<String>) -> anyhow::Result<()> {
        if self.finished.contains(node) {
            return Ok(());
        }
        // A node that starts again records the same messages again.
        self.switch(node, round, recording);
        self.show_text(node, Level::Info, "started")
    }

    fn on_node_finished(
        &mut self,
        node: String,
        round: Option<u32>,
        state: NodeState,
        recording: Option<String>,
    ) -> anyhow::Result<()> {
        if self.finished.contains(&node) {
            return Ok(());
        }
        // A recording that is gone from its place may have been made again by a repair.
        let is_there = recording.as_ref().is_some_and(|recording| self.folder.join(recording).exists());
        let remade = if is_there { None } else { self.recordings.of_node(&node) };
        self.switch(&node, round, remade.and_then(|path| path.into_os_string().into_string().ok()).or(recording));
        if let Some(mut playback) = self.working.remove(&node) {
            playback.show_rest(self.viewer, self.host)?;
            self.timeline.end(&playback.branch, playback.end);
            let text = format!("{node} {}", past_tense(state));
            self.show_text_at(&playback.position(), Level::Info, text)?;
        }
        self.finished.insert(node);
        Ok(())
    }

    /// Lets the node's playback continue with the recording that an event names.
    fn switch(&mut self, node: &str, round: Option<u32>, recording: Option<String>) {
        let lane = Lane::of(node);
        let start = self.timeline.start(&lane.branch);
        let make = || Playback::new(lane, &self.prefix, round.unwrap_or(0), start);
        let playback = self.working.entry(node.to_owned()).or_insert_with(make);
        if let Some(recording) = recording {
            playback.switch_to(self.folder.join(recording));
        }
    }

    /// Shows a text about a node among the node's messages. An empty name means the run as a whole.
    fn show_text(&mut self, node: &str, level: Level, text: &str) -> anyhow::Result<()> {
        let position = match self.working.get(node) {
            Some(playback) => playback.position(),
            None => Playback::new(Lane::of(RUN_LANE), &self.prefix, 0, self.timeline.start("")).position(),
        };
        let text = if node.is_empty() { text.to_owned() } else { format!("{node}: {text}") };
        self.show_text_at(&position, level, text)
    }

    fn show_text_at(&mut self, position: &Position, level: Level, text: String) -> anyhow::Result<()> {
        let frame = Frame::Log { level, text };
        self.viewer.show(position, &Message { topic: "/log".to_owned(), at: At::default(), frame })
    }
}

/// How a node ended, as the end of a sentence that begins with its name.
fn past_tense(state: NodeState) -> &'static str {
    match state {
        NodeState::Ran => "ran",
        NodeState::Cached => "cached",
        NodeState::Failed => "failed",
        NodeState::Stopped => "stopped",
        NodeState::Pending => "never started",
    }
}
