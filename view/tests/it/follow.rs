//! The follower shows every message once, whatever the run does meanwhile.

#![allow(clippy::disallowed_methods, reason = "tests wait for the recorder's clock")]

use std::{
    cell::{Cell, RefCell},
    collections::BTreeMap,
    fs,
    io::Write as _,
    path::{Path, PathBuf},
};

use carl_pipe::{
    record::{At, Frame, Level, Message, NodeInfo, Recorder},
    run::events::{Event, NodeState, RunState},
};
use carl_view::{Position, ViewHost, Viewer, follow, open};

/// Keeps what it is shown.
#[derive(Default)]
struct Shown(Vec<(Position, Message)>);

impl Shown {
    /// Lane, step on the common axis and value of every scalar.
    fn values(&self) -> Vec<(&str, u64, f64)> {
        let value = |(position, message): &'_ (Position, Message)| match &message.frame {
            Frame::Scalars { values, .. } => Some((position.step, values[0])),
            _ => None,
        };
        let of = |shown| value(shown).map(|(step, value)| (shown.0.lane.as_str(), step, value));
        self.0.iter().filter_map(of).collect()
    }

    /// Every text with its level.
    fn texts(&self) -> Vec<(Level, &str)> {
        let mut texts = Vec::new();
        for (_, message) in &self.0 {
            if let Frame::Log { level, text } = &message.frame {
                texts.push((*level, text.as_str()));
            }
        }
        texts
    }
}

impl Viewer for Shown {
    fn title(&mut self, title: &str) -> anyhow::Result<()> {
        let frame = Frame::Log { level: Level::Debug, text: title.to_owned() };
        let position = Position { lane: String::new(), round: 0, epoch: 0, step: 0 };
        self.0.push((position, Message { topic: "/title".into(), at: At::default(), frame }));
        Ok(())
    }

    fn show(&mut self, position: &Position, message: &Message) -> anyhow::Result<()> {
        self.0.push((position.clone(), message.clone()));
        Ok(())
    }

    fn close(&mut self, _: &dyn ViewHost) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Lets the run take its next step each time that the follower asks whether the run is alive.
struct Director<'a> {
    steps: RefCell<Vec<Box<dyn FnOnce() + 'a>>>,
    notes: RefCell<Vec<String>>,
    asked: Cell<u32>,
}

impl<'a> Director<'a> {
    fn new(mut steps: Vec<Box<dyn FnOnce() + 'a>>) -> Self {
        steps.reverse();
        Director { steps: RefCell::new(steps), notes: RefCell::default(), asked: Cell::new(0) }
    }
}

impl ViewHost for Director<'_> {
    fn should_stop(&self) -> bool {
        false
    }
    fn run_is_alive(&self) -> bool {
        self.asked.set(self.asked.get() + 1);
        assert!(self.asked.get() < 100, "the follower never ends");
        let step = self.steps.borrow_mut().pop();
        step.map(|step| step()).is_some()
    }
    fn note(&self, text: &str) {
        self.notes.borrow_mut().push(text.to_owned());
    }
}

fn line(run: &Path, line: &str) {
    let mut file = fs::OpenOptions::new().create(true).append(true).open(run.join("events.jsonl")).unwrap();
    writeln!(file, "{line}").unwrap();
}

fn event(run: &Path, event: &Event) {
    line(run, &serde_json::to_string(event).unwrap());
}

fn started(run: &Path, node: &str) {
    let recording = Some(format!("live/{node}.mcap"));
    event(run, &Event::NodeStarted { node: node.into(), kind: "train_lce".into(), round: Some(0), recording });
}

fn finished(run: &Path, node: &str, state: NodeState) {
    let finished = Event::NodeFinished {
        node: node.into(),
        kind: "train_lce".into(),
        round: Some(0),
        state,
        secs: 1.5,
        digest: None,
        recording: Some(format!("{node}.mcap")),
        metrics: BTreeMap::new(),
        error: None,
    };
    event(run, &finished);
}

fn create(run: &Path, node: &str) -> Recorder {
    let info = NodeInfo { node: node.into(), kind: "train_lce".into(), ..NodeInfo::default() };
    Recorder::create(&run.join(format!("live/{node}.mcap")), &info)
}

fn record(recorder: &mut Recorder, steps: std::ops::Range<u64>) {
    steps.for_each(|step| recorder.scalars("/train/lce", At::new(0, 0, step), &[("total", step as f64)]));
}

fn publish(run: &Path, node: &str, recorder: Recorder) {
    assert!(recorder.finish(&run.join(format!("{node}.mcap"))).path.is_some());
}

#[test]
fn a_run_is_followed_from_live_to_published_without_showing_a_message_twice() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    let recorder = RefCell::new(None);
    let director = Director::new(vec![
        Box::new(|| {
            let (run_id, pipeline) = ("20260802-1".into(), "planar_online".into());
            event(run, &Event::RunStarted { run: run_id, number: None, pipeline, seed: Some(7), nodes: 1 });
        }),
        Box::new(|| started(run, "represent@0")),
        Box::new(|| *recorder.borrow_mut() = Some(create(run, "represent@0"))),
        Box::new(|| {
            record(recorder.borrow_mut().as_mut().unwrap(), 0..3);
            // Long enough for the next call to flush.
            std::thread::sleep(std::time::Duration::from_millis(450));
            record(recorder.borrow_mut().as_mut().unwrap(), 3..4);
        }),
        Box::new(|| {
            let mut recorder = recorder.borrow_mut().take().unwrap();
            record(&mut recorder, 4..6);
            publish(run, "represent@0", recorder);
        }),
        Box::new(|| finished(run, "represent@0", NodeState::Ran)),
        Box::new(|| {
            let state = RunState::Finished;
            event(run, &Event::RunFinished { state, executed: 1, cached: 0, failed: 0, wall_secs: 2.5 });
        }),
    ]);
    let mut shown = Shown::default();
    follow(run, &mut shown, &director).unwrap();
    let values: Vec<_> = (0..6).map(|step| ("represent", step, step as f64)).collect();
    assert_eq!(shown.values(), values);
    let texts = [
        (Level::Debug, "planar_online seed 7"),
        (Level::Info, "represent@0: started"),
        (Level::Info, "represent@0 ran"),
    ];
    assert_eq!(shown.texts(), texts);
    assert_eq!(*director.notes.borrow(), [""; 0]);
    assert!(!director.run_is_alive() || director.steps.borrow().is_empty());
}

#[test]
fn a_run_that_was_killed_shows_what_its_live_recordings_hold() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    started(run, "represent@0");
    let mut recorder = create(run, "represent@0");
    record(&mut recorder, 0..3);
    drop(recorder);
    let live = run.join("live/represent@0.mcap");
    let bytes = fs::read(&live).unwrap();
    fs::write(&live, &bytes[..bytes.len() - 20]).unwrap();
    event(run, &Event::Say { node: "represent@0".into(), text: "loss grew".into() });
    fs::OpenOptions::new().append(true).open(run.join("events.jsonl")).unwrap().write_all(b"{\"event\":\"no").unwrap();

    let (director, mut shown) = (Director::new(Vec::new()), Shown::default());
    follow(run, &mut shown, &director).unwrap();
    assert_eq!(shown.values().len(), 3);
    assert_eq!(shown.texts(), [(Level::Info, "represent@0: started"), (Level::Info, "represent@0: loss grew")]);
    assert!(director.notes.borrow()[0].ends_with("ends early; showing what it holds"));
}

#[test]
fn cached_nodes_are_shown_and_nodes_lie_end_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    for (node, steps) in [("represent@0", 5), ("control@0", 3)] {
        let mut recorder = create(run, node);
        record(&mut recorder, 0..steps);
        publish(run, node, recorder);
        finished(run, node, NodeState::Cached);
    }
    // A run that goes on names the node again. The node is shown once.
    finished(run, "represent@0", NodeState::Cached);
    let (node, name) = ("control@0".into(), "percent_goal".into());
    event(run, &Event::Metric { node, round: Some(0), name, value: 74.1 });

    let (director, mut shown) = (Director::new(Vec::new()), Shown::default());
    open(&[run.to_owned()], &mut shown, &director).unwrap();
    let represent = (0..5).map(|step| ("represent", step, step as f64));
    let control = (0..3).map(|step| ("control", step + 5, step as f64));
    assert_eq!(shown.values(), represent.chain(control).collect::<Vec<_>>());
    let texts = ["represent@0 cached", "control@0 cached", "control@0: percent_goal = 74.1"];
    assert_eq!(shown.texts(), texts.map(|text| (Level::Info, text)));
}

#[test]
fn a_recording_that_cannot_be_read_is_said_and_the_others_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    fs::write(run.join("a.mcap"), "this is not a recording").unwrap();
    let mut recorder = create(run, "b");
    record(&mut recorder, 0..3);
    publish(run, "b", recorder);

    let (director, mut shown) = (Director::new(Vec::new()), Shown::default());
    let files: Vec<PathBuf> = ["a.mcap", "b.mcap"].map(|file| run.join(file)).into();
    open(&files, &mut shown, &director).unwrap();
    assert_eq!(shown.values().len(), 3);
    assert!(director.notes.borrow()[0].ends_with("a.mcap: it is not an MCAP file"), "{:?}", director.notes);

    let mut whole_folder = Shown::default();
    open(&[run.to_owned()], &mut whole_folder, &director).unwrap();
    assert_eq!(whole_folder.values(), shown.values());
}

#[test]
fn where_nothing_can_be_shown_there_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.mcap"), "this is not a recording").unwrap();
    let director = Director::new(Vec::new());
    let error = open(&[folder.path().to_owned()], &mut Shown::default(), &director).unwrap_err();
    assert_eq!(error.to_string(), "none of 1 files can be shown");
    let error = follow(folder.path(), &mut Shown::default(), &director).unwrap_err();
    assert!(error.to_string().ends_with("is no run that works, and holds no event"), "{error}");
    fs::write(folder.path().join("events.jsonl"), "no event\n").unwrap();
    let error = open(&[folder.path().to_owned()], &mut Shown::default(), &director).unwrap_err();
    assert!(error.to_string().ends_with("holds no event that could be shown"), "{error}");
}

#[test]
fn a_path_with_nothing_there_is_an_error() {
    let director = Director::new(Vec::new());
    let error = open(&["no/such/run".into()], &mut Shown::default(), &director).unwrap_err();
    assert_eq!(error.to_string(), "there is no run or recording at no/such/run");
}

#[test]
fn warnings_of_the_run_are_shown_as_warnings() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    event(run, &Event::Warning { node: Some("represent@0".into()), text: "the loss is not finite".into() });
    event(run, &Event::Warning { node: None, text: "the disk is almost full".into() });
    let (director, mut shown) = (Director::new(Vec::new()), Shown::default());
    open(&[run.to_owned()], &mut shown, &director).unwrap();
    let texts = ["represent@0: the loss is not finite", "the disk is almost full"];
    assert_eq!(shown.texts(), texts.map(|text| (Level::Warning, text)));
}

#[test]
fn events_and_fields_of_other_versions_are_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    line(run, r#"{"event":"run_started","pipeline":"planar_online","host":"a new field"}"#);
    line(run, r#"{"event":"node_moved","node":"represent@0","from":"a new event"}"#);
    line(run, r#"{"event":"node_started","node":"represent@0"}"#);
    line(run, r#"{"event":"node_finished","node":"represent@0","state":"ran","watts":12}"#);
    let (director, mut shown) = (Director::new(Vec::new()), Shown::default());
    open(&[run.to_owned()], &mut shown, &director).unwrap();
    let texts: Vec<&str> = shown.texts().into_iter().map(|(_, text)| text).collect();
    assert_eq!(texts, ["planar_online", "represent@0: started", "represent@0 ran"]);
}
