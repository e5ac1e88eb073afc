//! How the program ends: a documented code, and an error in one shape.

use crate::store;

/// The exit codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Exit {
    Ok = 0,
    StageFailed = 1,
    Usage = 2,
    PipelineInvalid = 3,
    Store = 4,
    ReplayDiffers = 6,
    Busy = 7,
    Stale = 10,
    Interrupted = 130,
}

/// Ends of the help text that say what the codes mean.
pub(crate) const CODES: &str = "Exit codes: 0 ok, 1 a stage failed, 2 usage, 3 pipeline file invalid, 4 store or system \
error, 6 replay differs, 7 store busy, 10 status: stale, 130 interrupted (run the same command again)";

/// What stops the program: a clause, and perhaps the next step.
#[derive(Debug)]
pub(crate) struct Error {
    pub(crate) exit: Exit,
    pub(crate) text: Message,
    pub(crate) help: Option<String>,
}

/// How the text of an error is made.
#[derive(Debug)]
pub(crate) enum Message {
    /// A lower-case clause.
    Clause(String),
    /// Several mistakes, already underlined.
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

/// An error of the engine is a fault of the store or the system.
impl From<anyhow::Error> for Error {
    fn from(error: anyhow::Error) -> Self {
        Self::new(Exit::Store, format!("{error:#}"))
    }
}

impl From<store::Error> for Error {
    fn from(error: store::Error) -> Self {
        let exit = match error {
            store::Error::Busy(_) => Exit::Busy,
            store::Error::OtherFormat { .. } | store::Error::Unusable { .. } | store::Error::Io { .. } => Exit::Store,
        };
        Self::new(exit, format!("{:#}", anyhow::Error::from(error)))
    }
}
