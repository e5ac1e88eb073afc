//! Opens the stream of a sink: to a viewer that is started, to one that listens, to viewers that connect, or to a file.

#![allow(clippy::disallowed_methods, reason = "wall time bounds how long a viewer may take to start")]

use std::{
    net::{TcpStream, ToSocketAddrs as _},
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context as _, bail};
use carl_pipe::cli::Sink;
use rerun::{MemoryLimit, RecordingStream, RecordingStreamBuilder, ServerOptions, SpawnOptions};

use crate::{blueprint::APPLICATION, host::ViewHost};

/// How to get a viewer of the same version as the SDK.
const INSTALL: &str = "install it with `pip install rerun-sdk==0.36.3`";
/// Above this limit a viewer drops its oldest data. The viewer's own limit is 75 % of the machine's memory.
const VIEWER_MEMORY: &str = "2GiB";
const SERVER_MEMORY: u64 = 2 << 30;
const START_TIMEOUT: Duration = Duration::from_secs(30);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);

/// Opens the stream of a sink.
///
/// # Errors
/// If no viewer can be started or reached, the port is taken, or the file cannot be written.
pub(crate) fn open(sink: &Sink, host: &dyn ViewHost) -> anyhow::Result<RecordingStream> {
    let builder = RecordingStreamBuilder::new(APPLICATION);
    let stream = match sink {
        Sink::Spawn => builder.connect_grpc_opts(Sink::viewer_url("127.0.0.1", spawn_viewer()?))?,
        Sink::Connect { url } => connect(builder, url)?,
        Sink::Serve { port } => serve(builder, *port, host)?,
        Sink::Save { path } => save(builder, path)?,
    };
    // The view has logical time only.
    stream.set_log_time_enabled(false);
    stream.set_log_tick_enabled(false);
    Ok(stream)
}

fn connect(builder: RecordingStreamBuilder, url: &str) -> anyhow::Result<RecordingStream> {
    // If nobody listens, the SDK blocks for ever.
    if !is_listening(url) {
        bail!("no viewer listens at {url}; start one with `rerun`, or {INSTALL} first");
    }
    Ok(builder.connect_grpc_opts(url)?)
}

fn serve(builder: RecordingStreamBuilder, port: u16, host: &dyn ViewHost) -> anyhow::Result<RecordingStream> {
    let url = Sink::viewer_url("127.0.0.1", port);
    if is_listening(&url) {
        bail!("port {port} is taken; choose another with `serve=PORT`");
    }
    let memory_limit = MemoryLimit::from_bytes(SERVER_MEMORY);
    host.note(&format!("serving viewers: `rerun {url}`"));
    Ok(builder.serve_grpc_opts("0.0.0.0", port, ServerOptions { memory_limit, ..ServerOptions::default() })?)
}

fn save(builder: RecordingStreamBuilder, path: &Path) -> anyhow::Result<RecordingStream> {
    // The SDK's error repeats its cause three times, so the file is created here first.
    std::fs::File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(builder.save(path)?)
}

/// Starts a viewer, or finds the one that runs. Returns its port once it listens.
fn spawn_viewer() -> anyhow::Result<u16> {
    let options = SpawnOptions { memory_limit: VIEWER_MEMORY.to_owned(), ..SpawnOptions::default() };
    let port = match rerun::spawn(&options) {
        Ok(viewer) => viewer.port,
        Err(rerun::SpawnError::ExecutableNotFoundInPath { .. }) => {
            bail!("there is no viewer `rerun` on the PATH; {INSTALL}")
        }
        Err(error) => return Err(error).context("cannot start the viewer `rerun`"),
    };
    let started = Instant::now();
    while !is_listening(&Sink::viewer_url("127.0.0.1", port)) {
        if started.elapsed() > START_TIMEOUT {
            bail!("the viewer `rerun` did not start within {} s", START_TIMEOUT.as_secs());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(port)
}

/// True if something accepts connections at the host and port of a viewer's URL.
fn is_listening(url: &str) -> bool {
    let addresses = Sink::address(url).and_then(|address| address.to_socket_addrs().ok());
    addresses.into_iter().flatten().any(|address| TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).is_ok())
}
