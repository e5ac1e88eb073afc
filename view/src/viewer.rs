//! The viewer contract: a viewer draws messages at positions on the axes of a run.

use carl_pipe::record::Message;

use crate::host::ViewHost;

/// The position of a message on the common axes of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Position {
    /// Name of the node without its round, such as `represent` or `represent[seed=3]`.
    pub lane: String,
    /// Round of the loop.
    pub round: u32,
    /// Epochs since the run began; the nodes of a run lie end to end.
    pub epoch: u64,
    /// Steps since the run began; the nodes of a run lie end to end.
    pub step: u64,
}

/// Draws messages.
pub trait Viewer {
    /// Sets the title of the view.
    ///
    /// # Errors
    /// If the viewer is gone.
    fn title(&mut self, title: &str) -> anyhow::Result<()>;

    /// Draws one message.
    ///
    /// # Errors
    /// If the viewer is gone.
    fn show(&mut self, position: &Position, message: &Message) -> anyhow::Result<()>;

    /// Hands over what is still buffered, within a few seconds. A viewer that serves other viewers returns only when
    /// the host asks it to stop.
    ///
    /// # Errors
    /// If buffered messages could not be handed over.
    fn close(&mut self, host: &dyn ViewHost) -> anyhow::Result<()>;
}
