//! What a view of recordings is, whatever draws it.

use super::{Message, Sink};

/// Where on a run's common axes a message lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The node without its round, such as `represent` or `represent[seed=3]`.
    pub lane: String,
    /// Round of the loop.
    pub round: u32,
    /// Epochs since the run began, its nodes laid end to end.
    pub epoch: u64,
    /// Steps since the run began, its nodes laid end to end.
    pub step: u64,
}

/// Shows messages.
pub trait Screen {
    /// Names what is shown.
    ///
    /// # Errors
    /// If the screen is gone.
    fn title(&mut self, title: &str) -> anyhow::Result<()>;

    /// Shows a message at its place.
    ///
    /// # Errors
    /// If the screen is gone.
    fn show(&mut self, place: &Place, message: &Message) -> anyhow::Result<()>;

    /// Everything was shown: hands over what is still buffered, within a few seconds. A screen that serves viewers
    /// goes on until it is stopped.
    ///
    /// # Errors
    /// If something could not be handed over.
    fn close(&mut self, watcher: &dyn Watcher) -> anyhow::Result<()>;
}

/// Whoever asked for a view.
pub trait Watcher {
    /// True once the view should end.
    fn stop(&self) -> bool;
    /// False once the run's process is gone, so that no event can follow.
    fn alive(&self) -> bool;
    /// A sentence for the user, such as a recording that cannot be read.
    fn say(&self, text: &str);
}

/// This package draws nothing itself: `carl-view` does.
pub(super) fn open(_: &Sink, _: &dyn Watcher) -> anyhow::Result<Box<dyn Screen>> {
    anyhow::bail!("recordings open in any MCAP viewer; the Rerun view is built by `cargo build --release -p carl-view`")
}
