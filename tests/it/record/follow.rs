//! Following a run: every message once, whatever the run does meanwhile.

use std::{
    cell::{Cell, RefCell},
    fs,
    io::Write as _,
    path::{Path, PathBuf},
};

use carl_pipe::record::{
    At, Frame, Message, NodeInfo, Place, Recorder, Screen, Sink, Watcher, follow_on, open, open_on,
};

/// Keeps what it is shown.
#[derive(Default)]
struct Seen(Vec<(Place, Message)>);

impl Seen {
    /// Lane, step on the common axis and value of every scalar.
    fn values(&self) -> Vec<(&str, u64, f64)> {
        let value = |(place, message): &'_ (Place, Message)| match &message.frame {
            Frame::Scalars { values, .. } => Some(values[0]).map(|value| (place.step, value)),
            _ => None,
        };
        self.0.iter().filter_map(|seen| value(seen).map(|(step, value)| (seen.0.lane.as_str(), step, value))).collect()
    }

    fn texts(&self) -> Vec<&str> {
        let text = |message: &'_ Message| matches!(message.frame, Frame::Log { .. });
        let texts = self.0.iter().filter(|(_, message)| text(message));
        texts.map(|(_, m)| if let Frame::Log { text, .. } = &m.frame { text.as_str() } else { "" }).collect()
    }
}

impl Screen for Seen {
    fn title(&mut self, title: &str) -> anyhow::Result<()> {
        let frame = Frame::Log { level: carl_pipe::record::Level::Info, text: title.to_owned() };
        let place = Place { lane: String::new(), round: 0, epoch: 0, step: 0 };
        self.0.push((place, Message { topic: "/title".into(), at: At::default(), frame }));
        Ok(())
    }

    fn show(&mut self, place: &Place, message: &Message) -> anyhow::Result<()> {
        self.0.push((place.clone(), message.clone()));
        Ok(())
    }

    fn close(&mut self, _: &dyn Watcher) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Lets the run do its next act each time it is asked whether the run is alive.
struct Director<'a> {
    acts: RefCell<Vec<Box<dyn FnOnce() + 'a>>>,
    said: RefCell<Vec<String>>,
    asked: Cell<u32>,
}

impl<'a> Director<'a> {
    fn new(mut acts: Vec<Box<dyn FnOnce() + 'a>>) -> Self {
        acts.reverse();
        Director { acts: RefCell::new(acts), said: RefCell::default(), asked: Cell::new(0) }
    }
}

impl Watcher for Director<'_> {
    fn stop(&self) -> bool {
        false
    }
    fn alive(&self) -> bool {
        self.asked.set(self.asked.get() + 1);
        assert!(self.asked.get() < 100, "the follower never ends");
        let act = self.acts.borrow_mut().pop();
        act.map(|act| act()).is_some()
    }
    fn say(&self, text: &str) {
        self.said.borrow_mut().push(text.to_owned());
    }
}

fn event(run: &Path, line: &str) {
    let mut file = fs::OpenOptions::new().create(true).append(true).open(run.join("events.jsonl")).unwrap();
    writeln!(file, "{line}").unwrap();
}

fn started(run: &Path, node: &str) {
    event(run, &format!(r#"{{"event":"node_started","node":"{node}","round":0,"recording":"live/{node}.mcap"}}"#));
}

fn finished(run: &Path, node: &str, state: &str) {
    event(
        run,
        &format!(
            r#"{{"event":"node_finished","node":"{node}","round":0,"state":"{state}","recording":"{node}.mcap"}}"#
        ),
    );
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
        Box::new(|| event(run, r#"{"event":"run_started","pipeline":"planar_online","seed":7}"#)),
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
        Box::new(|| finished(run, "represent@0", "ran")),
        Box::new(|| event(run, r#"{"event":"run_finished","new_field":1}"#)),
    ]);
    let mut seen = Seen::default();
    follow_on(run, &mut seen, &director).unwrap();
    let values: Vec<_> = (0..6).map(|step| ("represent", step, step as f64)).collect();
    assert_eq!(seen.values(), values);
    assert_eq!(seen.texts(), ["planar_online seed 7", "represent@0: started", "represent@0 ran"]);
    assert_eq!(*director.said.borrow(), [""; 0]);
    assert!(!director.alive() || director.acts.borrow().is_empty());
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
    event(run, r#"{"event":"say","node":"represent@0","text":"loss grew"}"#);
    fs::OpenOptions::new().append(true).open(run.join("events.jsonl")).unwrap().write_all(b"{\"event\":\"no").unwrap();

    let (director, mut seen) = (Director::new(Vec::new()), Seen::default());
    follow_on(run, &mut seen, &director).unwrap();
    assert_eq!(seen.values().len(), 3);
    assert_eq!(seen.texts(), ["represent@0: started", "represent@0: loss grew"]);
    assert!(director.said.borrow()[0].ends_with("ends early; showing what it holds"));
}

#[test]
fn cached_nodes_are_shown_and_nodes_lie_end_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    for (node, steps) in [("represent@0", 5), ("control@0", 3)] {
        let mut recorder = create(run, node);
        record(&mut recorder, 0..steps);
        publish(run, node, recorder);
        finished(run, node, "cached");
    }
    // Named again, as a run does that goes on: shown once.
    finished(run, "represent@0", "cached");
    event(run, r#"{"event":"figure","node":"control@0","name":"percent_goal","value":74.1}"#);

    let (director, mut seen) = (Director::new(Vec::new()), Seen::default());
    open_on(&[run.to_owned()], &mut seen, &director).unwrap();
    let represent = (0..5).map(|step| ("represent", step, step as f64));
    let control = (0..3).map(|step| ("control", step + 5, step as f64));
    assert_eq!(seen.values(), represent.chain(control).collect::<Vec<_>>());
    assert_eq!(seen.texts(), ["represent@0 cached", "control@0 cached", "control@0: percent_goal = 74.1"]);
}

#[test]
fn a_recording_that_cannot_be_read_is_said_and_the_others_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    fs::write(run.join("a.mcap"), "this is not a recording").unwrap();
    let mut recorder = create(run, "b");
    record(&mut recorder, 0..3);
    publish(run, "b", recorder);

    let (director, mut seen) = (Director::new(Vec::new()), Seen::default());
    let files: Vec<PathBuf> = ["a.mcap", "b.mcap"].map(|file| run.join(file)).into();
    open_on(&files, &mut seen, &director).unwrap();
    assert_eq!(seen.values().len(), 3);
    assert!(director.said.borrow()[0].contains("a.mcap: "), "{:?}", director.said);

    let mut whole_folder = Seen::default();
    open_on(&[run.to_owned()], &mut whole_folder, &director).unwrap();
    assert_eq!(whole_folder.values(), seen.values());
}

#[test]
fn a_path_with_nothing_there_is_an_error() {
    let director = Director::new(Vec::new());
    let error = open(&["no/such/run".into()], &Sink::Spawn, &director).unwrap_err();
    assert_eq!(error.to_string(), "there is no run or recording at no/such/run");
}
