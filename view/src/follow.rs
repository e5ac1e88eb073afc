//! Follows a run while it works.

use std::{path::Path, time::Duration};

use anyhow::bail;

use crate::{host::ViewHost, run_view::RunView, viewer::Viewer};

/// How often a follower looks for new events and messages.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Shows a run as it works. Returns once the run has finished, its process is gone, or the host asks to stop.
///
/// # Errors
/// If the viewer is gone, the run's events cannot be read, or the process of the run is gone and there is no event. A recording that cannot be read is reported to the host,
/// and the view goes on.
pub fn follow(run_dir: &Path, viewer: &mut dyn Viewer, host: &dyn ViewHost) -> anyhow::Result<()> {
    let mut run = RunView::new(run_dir, String::new(), viewer, host);
    while !run.has_ended() && !host.should_stop() {
        // The order matters: events that a process wrote just before it ended are still read.
        let is_alive = host.run_is_alive();
        if !run.show_new()? {
            if !is_alive {
                break;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
    if run.is_empty() && !host.should_stop() {
        bail!("{} is no run that works, and holds no event", run_dir.display());
    }
    run.close()
}
