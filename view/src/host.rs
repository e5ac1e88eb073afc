//! The host contract: what a view asks of the program around it.

/// The program around a view.
pub trait ViewHost {
    /// True once the view should end.
    fn should_stop(&self) -> bool;

    /// True while the run's process lives. After it has ended, no event can follow.
    fn run_is_alive(&self) -> bool;

    /// Shows a sentence to the user, for example that a recording cannot be read.
    fn note(&self, text: &str);
}
