//! One start of the program, in folders of its own.

use std::{
    env, fs,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context as _, anyhow};
use rand::RngExt as _;

use super::{
    events::Events,
    inputs::Given,
    outputs::Declaration,
    params::{Params, name_of},
    places::{Place, places},
    readers::reader,
};
use crate::{
    artifact::Files,
    program::{self, EVENTS, End, Launch, Line, Source, Watch},
    record::{At, Level},
    stage::{Interrupted, StageCx},
};

/// How many lines of each stream are recorded, from its beginning and from its end.
const RECORDED: usize = 5_000;
/// The most characters of a line that are kept.
const LONGEST: usize = 1_000;
/// How many lines an error shows.
const SHOWN: usize = 10;

/// One start of the program.
#[derive(Debug)]
pub(super) struct Attempt<'a> {
    pub(super) params: &'a Params,
    pub(super) inputs: &'a Given,
    /// The folder of this attempt.
    pub(super) folder: PathBuf,
}

/// Why an attempt failed.
#[derive(Debug)]
pub(super) struct Failed {
    pub(super) error: anyhow::Error,
    /// Whether another attempt may end otherwise.
    pub(super) may_help: bool,
}

impl<E: Into<anyhow::Error>> From<E> for Failed {
    fn from(error: E) -> Self {
        Self { error: error.into(), may_help: false }
    }
}

impl Attempt<'_> {
    /// Runs the program and takes in what it wrote.
    pub(super) fn run(&self, cx: &mut StageCx<'_>) -> Result<Files, Failed> {
        let outputs = Declaration::new(&self.params.outputs).map_err(|refusal| anyhow!("{}", refusal.why))?;
        let (work, out) = (self.folder.join("work"), self.folder.join("out"));
        fs::create_dir_all(&work)?;
        fs::create_dir_all(&out)?;
        outputs.make_folders(&out)?;
        self.copy_program(&work, cx)?;
        let argv = self.argv(&outputs, &out, cx)?;
        let mark = format!("CARL_FOLDER={}", self.folder.display());
        let variables = self.variables(&work);
        let limit = Some(self.params.timeout).filter(|&secs| secs > 0).map(Duration::from_secs);
        let launch = Launch { argv: &argv, variables: &variables, mark: &mark, folder: &work, limit };
        let mut listener = Listener { cx, events: Events::default(), text: [Text::default(), Text::default()] };
        let end = program::run(&launch, &mut listener);
        let last_words = listener.record_text();
        self.inputs.must_be_unchanged()?;
        self.judge(end?, &last_words)?;
        let files = outputs.collect(&out)?;
        let reader = reader(self.params.gives);
        (reader.check)(&files, cx).with_context(|| format!("what the program wrote is no {}", reader.artifact))?;
        Ok(files)
    }

    /// Copies the files of the program into its working folder.
    fn copy_program(&self, work: &Path, cx: &StageCx<'_>) -> anyhow::Result<()> {
        for (path, &content) in &self.params.found.files {
            let place = work.join(name_of(path).with_context(|| format!("`{path}` has no name"))?);
            place.parent().map_or(Ok(()), fs::create_dir_all)?;
            let copied = cx.file(content).and_then(|file| Ok(fs::copy(file, &place)?));
            copied.with_context(|| format!("cannot copy the file `{path}` of the program"))?;
        }
        Ok(())
    }

    /// The words of the command, with every place filled.
    fn argv(&self, outputs: &Declaration<'_>, out: &Path, cx: &StageCx<'_>) -> anyhow::Result<Vec<String>> {
        let path = |path: PathBuf| path.into_os_string().into_string().map_err(|_| anyhow!("a path is not UTF-8"));
        let fill = |place: Place<'_>| {
            Ok(match place {
                Place::Text(text) => text.to_owned(),
                Place::Input(name) => path(self.inputs.place(name))?,
                Place::Output(name) => path(outputs.place(name, out).context("an output is not declared")?)?,
                Place::Param(name) => match &self.params.params[name] {
                    serde_json::Value::String(text) => text.clone(),
                    other => other.to_string(),
                },
                Place::Seed => cx.rng("seed").random::<u32>().to_string(),
                Place::Threads => cx.threads.get().to_string(),
            })
        };
        let word = |word: &String| places(word).map_err(anyhow::Error::msg)?.into_iter().map(fill).collect();
        self.params.argv.iter().map(word).collect()
    }

    /// The environment: what every program gets, and what the stage allows.
    fn variables(&self, work: &Path) -> Vec<(String, String)> {
        let params = serde_json::to_string(&self.params.params).unwrap_or_default();
        let mut variables: Vec<(String, String)> =
            ["PATH", "HOME"].iter().filter_map(|name| Some(((*name).to_owned(), env::var(name).ok()?))).collect();
        let own = [
            ("LANG", "C.UTF-8".to_owned()),
            ("TZ", "UTC".to_owned()),
            ("TMPDIR", work.display().to_string()),
            // Sets and dictionaries of Python in the same order each time.
            ("PYTHONHASHSEED", "0".to_owned()),
            ("PYTHONDONTWRITEBYTECODE", "1".to_owned()),
            ("CARL_EVENTS", EVENTS.to_string()),
            ("CARL_PARAMS", params),
            ("CARL_FOLDER", self.folder.display().to_string()),
        ];
        variables.extend(own.map(|(name, value)| (name.to_owned(), value)));
        for (name, value) in &self.params.found.variables {
            variables.retain(|(other, _)| other != name);
            variables.push((name.clone(), value.clone()));
        }
        variables
    }

    /// Refuses every end but exit status 0 with nothing left behind.
    fn judge(&self, end: End, last_words: &str) -> Result<(), Failed> {
        let error = match end {
            End::Exit(0) => return Ok(()),
            End::Stopped => return Err(Interrupted.into()),
            End::Exit(code) => format!("the program ended with exit status {code}{last_words}"),
            End::Signal(number) => format!("the program was killed by signal {number}{last_words}"),
            End::TimedOut => {
                format!("the program took longer than its `timeout` of {} s{last_words}", self.params.timeout)
            }
            End::LeftBehind(left) => {
                let left: Vec<String> = left.iter().map(ToString::to_string).collect();
                let left = left.join(", ");
                let error = anyhow!("the program ended but left {left} behind, which could still write; wait for it");
                return Err(error.into());
            }
        };
        Err(Failed { error: anyhow!(error), may_help: true })
    }
}

/// Takes in what the program writes while it works.
struct Listener<'a, 'c> {
    cx: &'a mut StageCx<'c>,
    events: Events,
    /// Standard output and standard error.
    text: [Text; 2],
}

/// The first and the last lines of a stream.
#[derive(Default)]
struct Text {
    first: Vec<String>,
    last: std::collections::VecDeque<String>,
    left_out: u64,
}

impl Watch for Listener<'_, '_> {
    fn stop_asked(&mut self) -> bool {
        self.cx.stop_asked()
    }

    fn line(&mut self, line: Line) -> anyhow::Result<()> {
        match line.source {
            Source::Events => return self.events.take(&line.text, self.cx),
            Source::Output => {
                let (done, total) = self.events.progress;
                self.cx.show_progress(done, total, &line.text);
                self.text[0].push(line.text);
            }
            Source::Error => self.text[1].push(line.text),
        }
        Ok(())
    }
}

impl Listener<'_, '_> {
    /// Records both streams, one after the other: which line came first between them is chance. Returns the last lines
    /// for an error.
    fn record_text(&mut self) -> String {
        for (text, level) in self.text.iter().zip([Level::Info, Level::Warning]) {
            let gap = (text.left_out > 0).then(|| format!("… {} lines are left out …", text.left_out));
            for (number, line) in text.first.iter().chain(&gap).chain(&text.last).enumerate() {
                self.cx.record.log(At::new(self.cx.round, 0, number as u64), level, line);
            }
        }
        let [output, error] = &self.text;
        let spoken = if error.first.is_empty() { output } else { error };
        let lines: Vec<&String> = spoken.first.iter().chain(&spoken.last).collect();
        let lines = lines[lines.len().saturating_sub(SHOWN)..].iter();
        let lines: Vec<String> = lines.map(|line| format!("\n  | {line}")).collect();
        if lines.is_empty() { " without a word".to_owned() } else { format!("; its last words:{}", lines.concat()) }
    }
}

impl Text {
    fn push(&mut self, mut line: String) {
        if let Some((end, _)) = line.char_indices().nth(LONGEST) {
            line.truncate(end);
        }
        if self.first.len() < RECORDED {
            self.first.push(line);
            return;
        }
        self.last.push_back(line);
        if self.last.len() > RECORDED {
            self.last.pop_front();
            self.left_out += 1;
        }
    }
}
