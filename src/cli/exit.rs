//! Exit codes, and the one shape of errors.

use crate::{
    diag::nearest,
    run::{manifest::Unreadable, runs},
    store,
};

/// The exit code of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Exit {
    Ok = 0,
    StageFailed = 1,
    Usage = 2,
    PipelineInvalid = 3,
    Store = 4,
    Damaged = 5,
    ReplayDiffers = 6,
    Busy = 7,
    Stale = 10,
    Interrupted = 130,
}

/// The meaning of the exit codes, for the end of the help text.
pub(crate) const CODES: &str = "Exit codes: 0 success, 1 a stage failed, 2 wrong usage, 3 invalid pipeline file, \
4 error of the store or the system (also output that cannot be written), 5 damaged or missing results (`verify`), 6 the replay differs, 7 the store is busy, 10 a node is stale (`status`), \
130 interrupted (the same command continues the run)";

/// An error that ends the program, and the next step for the user if there is one.
#[derive(Debug)]
pub(crate) struct Error {
    pub(crate) exit: Exit,
    pub(crate) text: Message,
    pub(crate) help: Option<String>,
}

/// The text of an error.
#[derive(Debug)]
pub(crate) enum Message {
    /// A lower-case clause.
    Clause(String),
    /// Mistakes in a pipeline file, rendered with their places.
    Rendered(String),
}

impl Error {
    pub(crate) fn new(exit: Exit, text: impl Into<String>) -> Self {
        Self { exit, text: Message::Clause(text.into()), help: None }
    }

    pub(crate) fn usage(text: impl Into<String>) -> Self {
        Self::new(Exit::Usage, text)
    }

    pub(crate) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// An untyped error comes from the store or the system.
impl From<anyhow::Error> for Error {
    fn from(error: anyhow::Error) -> Self {
        Self::new(Exit::Store, format!("{error:#}"))
    }
}

impl From<store::Error> for Error {
    fn from(error: store::Error) -> Self {
        let exit = match error {
            store::Error::Busy(_) => Exit::Busy,
            store::Error::NotAStore { .. }
            | store::Error::OtherFormat { .. }
            | store::Error::Unusable { .. }
            | store::Error::Io { .. } => Exit::Store,
        };
        Self::new(exit, format!("{:#}", anyhow::Error::from(error)))
    }
}

impl From<runs::FindError> for Error {
    fn from(error: runs::FindError) -> Self {
        let text = error.to_string();
        let help = match error {
            runs::FindError::Unreadable(error) => return error.into(),
            runs::FindError::NoRuns(_) => "start one with `carl-pipe run PIPELINE`".to_owned(),
            runs::FindError::TooOld { .. } => "`carl-pipe log` lists the runs".to_owned(),
            runs::FindError::Ambiguous { found, .. } => format!("give more of an id: {}", few(&found)),
            runs::FindError::Unknown { wanted, known } => match nearest(&wanted, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`? `carl-pipe log` lists the runs"),
                None => format!("runs are called {}; `carl-pipe log` lists them", few(&known)),
            },
        };
        Self::usage(text).help(help)
    }
}

/// The first names of a list.
fn few(names: &[String]) -> String {
    let shown: Vec<String> = names.iter().take(6).map(|name| format!("`{name}`")).collect();
    let rest = names.len().saturating_sub(shown.len());
    let rest = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("{}{rest}", shown.join(", "))
}

impl From<Unreadable> for Error {
    fn from(error: Unreadable) -> Self {
        let help = match error {
            Unreadable::Missing(_) => "the run was stopped before its first node worked; run its pipeline again",
            Unreadable::Damaged { .. } => {
                "the results are not affected: run its pipeline again, then `carl-pipe gc --drop RUN` removes this run"
            }
            Unreadable::OtherFormat { .. } => "use the carl-pipe that made the run",
            Unreadable::System { .. } => "look at the rights of the file",
        };
        Self::new(Exit::Store, format!("{:#}", anyhow::Error::from(error))).help(help)
    }
}
