//! Draws recordings with Rerun: one tree of entities on the timelines `step`, `epoch` and `round`.
//!
//! An entity is a topic, the value's name where the topic has several, and the lane of the node.

#![allow(
    clippy::disallowed_methods,
    reason = "wall time paces flushes and measures the cost of recording; recordings hold logical time only"
)]

use std::{
    collections::BTreeMap,
    net::{TcpStream, ToSocketAddrs as _},
    time::{Duration, Instant},
};

use anyhow::{Context as _, bail};
use rerun::{
    Color, EntityPath, EntityPathPart, Image, LineStrips2D, MemoryLimit, Points2D, Points3D, Radius, RecordingStream,
    RecordingStreamBuilder, Scalars, SeriesLines, SeriesPoints, ServerOptions, SpawnOptions, TextLog,
};

use super::{
    Frame, Level, Message, Place, Screen, Sink, Watcher,
    blueprint::{APPLICATION, Layout},
    sink::url,
    topic,
};

/// The version of viewer that this SDK speaks to.
const INSTALL: &str = "install it with `pip install rerun-sdk==0.36.3`";
/// Beyond this a viewer drops its oldest data; without it, a long run wedges the machine.
const VIEWER_MEMORY: &str = "2GiB";
const SERVER_MEMORY: u64 = 2 << 30;
const START_TIMEOUT: Duration = Duration::from_secs(30);
const FLUSH_TIMEOUT: Duration = Duration::from_secs(2);

/// A Rerun viewer, or a file for one.
pub(super) struct RerunView {
    stream: RecordingStream,
    sink: Sink,
    layout: Layout,
    /// The latest value of every curve.
    latest: BTreeMap<EntityPath, Place>,
}

impl RerunView {
    pub(super) fn open(sink: &Sink, watcher: &dyn Watcher) -> anyhow::Result<RerunView> {
        let layout = Layout::default();
        let builder = RecordingStreamBuilder::new(APPLICATION);
        let stream = match sink {
            Sink::Spawn => {
                let port = spawn()?;
                builder.connect_grpc_opts(url("127.0.0.1", port))?
            }
            Sink::Connect { url } => {
                // Towards an address where nobody listens, the SDK blocks for ever.
                if !listens(url) {
                    bail!("no viewer listens at {url}; start one with `rerun`, or {INSTALL} first");
                }
                builder.connect_grpc_opts(url.clone())?
            }
            Sink::Serve { port } => {
                if listens(&url("127.0.0.1", *port)) {
                    bail!("port {port} is taken; choose another with `serve=PORT`");
                }
                let memory_limit = MemoryLimit::from_bytes(SERVER_MEMORY);
                let options = ServerOptions { memory_limit, ..ServerOptions::default() };
                watcher.say(&format!("serving viewers: `rerun {}`", url("127.0.0.1", *port)));
                builder.serve_grpc_opts("0.0.0.0", *port, options)?
            }
            Sink::Save { path } => builder.save(path).with_context(|| format!("cannot write {}", path.display()))?,
        };
        stream.set_log_time_enabled(false);
        stream.set_log_tick_enabled(false);
        layout.send(&stream)?;
        Ok(RerunView { stream, sink: sink.clone(), layout, latest: BTreeMap::new() })
    }

    fn scalars(&mut self, place: &Place, topic: &str, names: &[String], values: &[f64]) -> anyhow::Result<()> {
        if self.layout.sees(topic, names, values) {
            self.layout.send(&self.stream)?;
        }
        for (name, &value) in names.iter().zip(values) {
            let entity = entity(topic, [name.as_str(), &place.lane]);
            match self.latest.insert(entity.clone(), place.clone()) {
                None => self.style(&entity, topic, name, &place.lane)?,
                Some(last) if last.round != place.round && topic.starts_with("/train/") => {
                    self.interrupt(&entity, &last)?;
                    self.set_time(place);
                }
                Some(_) => {}
            }
            self.stream.log(entity, &Scalars::single(value))?;
        }
        Ok(())
    }

    /// Ends a curve for a while: no line leads from the end of a round to the start of the next.
    fn interrupt(&self, entity: &EntityPath, last: &Place) -> anyhow::Result<()> {
        self.stream.reset_time();
        self.stream.set_time_sequence("step", sequence(last.step.saturating_add(1)));
        Ok(self.stream.log(entity.clone(), &Scalars::new(std::iter::empty::<f64>()))?)
    }

    fn set_time(&self, place: &Place) {
        self.stream.set_time_sequence("step", sequence(place.step));
        self.stream.set_time_sequence("epoch", sequence(place.epoch));
        self.stream.set_time_sequence("round", i64::from(place.round));
    }

    fn style(&self, entity: &EntityPath, topic: &str, name: &str, lane: &str) -> anyhow::Result<()> {
        let named = match lane.split_once('[') {
            Some((_, point)) => format!("{name} {}", point.trim_end_matches(']')),
            None => name.to_owned(),
        };
        let mut lines = SeriesLines::new().with_names([named.as_str()]).with_widths([1.5]);
        if topic == topic::PERCENT_GOAL {
            let colour = match name {
                "percent_goal" => Color::from_rgb(255, 200, 60),
                "policy_alone" => Color::from_rgb(220, 70, 140),
                "paper" => Color::from_rgb(150, 150, 150),
                _ => Color::from_rgb(90, 160, 255),
            };
            lines = lines.with_colors([colour]);
            // A single round is a point, which a line alone would not show.
            let points =
                SeriesPoints::new().with_names([named.as_str()]).with_colors([colour]).with_marker_sizes([4.0]);
            self.stream.log_static(entity.clone(), &points)?;
        }
        Ok(self.stream.log_static(entity.clone(), &lines)?)
    }

    fn points(
        &mut self,
        entity: EntityPath,
        points: &[[f32; 3]],
        colours: &[Color],
        radius: f32,
    ) -> anyhow::Result<()> {
        let radius = Radius::new_ui_points(radius);
        if self.layout.latents_have_depth(points) {
            self.layout.send(&self.stream)?;
        }
        let colours = colours.iter().copied();
        if self.layout.solid {
            let points = Points3D::new(points.iter().copied());
            Ok(self.stream.log(entity, &points.with_colors(colours).with_radii([radius]))?)
        } else {
            let points = Points2D::new(points.iter().map(|&[x, y, _]| (x, y)));
            Ok(self.stream.log(entity, &points.with_colors(colours).with_radii([radius]))?)
        }
    }

    fn obstacles(&self, entity: EntityPath, circles: &[[f32; 3]]) -> anyhow::Result<()> {
        let discs = Points2D::new(circles.iter().map(|&[row, col, _]| (col, row)))
            .with_radii(circles.iter().map(|circle| Radius::new_scene_units(circle[2])))
            .with_colors([Color::from_rgb(90, 90, 100)])
            .with_draw_order(-10.0);
        Ok(self.stream.log(entity, &discs)?)
    }

    fn trajectory(&self, place: &Place, topic: &str, frame: &Frame) -> anyhow::Result<()> {
        let Frame::Trajectory { episode, path, goal, radius, percent_goal } = frame else { return Ok(()) };
        let below = |part: &str| entity(topic, [place.lane.as_str(), &format!("episode {episode}"), part]);
        let colour = episode_colour(*episode);
        let [goal_row, goal_col] = *goal;
        let line = LineStrips2D::new([path.iter().map(|&[row, col]| (col, row)).collect::<Vec<_>>()]);
        self.stream.log(below("path"), &line.with_colors([colour]).with_radii([Radius::new_ui_points(1.5)]))?;
        let ends = [path.first(), path.last()].into_iter().flatten().map(|&[row, col]| (col, row));
        let ends = Points2D::new(ends).with_radii([Radius::new_ui_points(2.5), Radius::new_ui_points(4.0)]);
        self.stream.log(below("ends"), &ends.with_colors([colour]))?;
        let circle = (0..=48).map(|i| {
            let (sin, cos) = (i as f32 / 48.0 * std::f32::consts::TAU).sin_cos();
            (goal_col + radius * cos, goal_row + radius * sin)
        });
        let circle = LineStrips2D::new([circle.collect::<Vec<_>>()])
            .with_colors([Color::from_rgb(230, 230, 230)])
            .with_radii([Radius::new_ui_points(0.75)])
            .with_labels([format!("episode {episode}: {percent_goal:.0} %")])
            .with_show_labels(false);
        Ok(self.stream.log(below("goal"), &circle)?)
    }
}

impl Screen for RerunView {
    fn title(&mut self, title: &str) -> anyhow::Result<()> {
        Ok(self.stream.send_recording_name(title)?)
    }

    fn show(&mut self, place: &Place, message: &Message) -> anyhow::Result<()> {
        self.set_time(place);
        let topic = message.topic.as_str();
        let here = entity(topic, [place.lane.as_str()]);
        match &message.frame {
            Frame::Scalars { names, values } => self.scalars(place, topic, names, values),
            Frame::LatentMap { latents, colours, .. } => {
                let colours: Vec<_> = colours.iter().map(|&[r, g, b, _]| Color::from_rgb(r, g, b)).collect();
                self.points(here, latents, &colours, 2.5)
            }
            Frame::Goals(goals) => self.points(here, goals, &[Color::from_rgb(255, 255, 255)], 6.0),
            Frame::Obstacles(circles) => self.obstacles(here, circles),
            Frame::Picture { height, width, grey } => {
                Ok(self.stream.log(here, &Image::from_l8(grey.clone(), [*width, *height]))?)
            }
            Frame::Trajectory { .. } => self.trajectory(place, topic, &message.frame),
            Frame::Log { level, text } => {
                let level = match level {
                    Level::Debug => "DEBUG",
                    Level::Info => "INFO",
                    Level::Warning => "WARN",
                    Level::Error => "ERROR",
                };
                Ok(self.stream.log(here, &TextLog::new(text.as_str()).with_level(level))?)
            }
        }
    }

    fn close(&mut self, watcher: &dyn Watcher) -> anyhow::Result<()> {
        if let Sink::Serve { .. } = self.sink {
            watcher.say("all is shown; serving on until interrupted");
            while !watcher.stop() {
                std::thread::sleep(Duration::from_millis(100));
            }
            return Ok(());
        }
        let timeout = if let Sink::Save { .. } = self.sink { Duration::from_secs(60) } else { FLUSH_TIMEOUT };
        match self.stream.flush_with_timeout(timeout) {
            Ok(()) => {}
            Err(error) => watcher.say(&format!("the viewer may not have received everything: {error}")),
        }
        if let Sink::Save { path } = &self.sink {
            self.stream.disconnect();
            watcher.say(&format!("wrote {}; open it with `rerun {}`", path.display(), path.display()));
        }
        Ok(())
    }
}

impl Drop for RerunView {
    /// A stream towards a viewer that hangs would hang in its own drop; the process is about to end anyway.
    fn drop(&mut self) {
        if !matches!(self.sink, Sink::Save { .. }) {
            std::mem::forget(std::mem::replace(&mut self.stream, RecordingStream::disabled()));
        }
    }
}

/// Starts a viewer, or finds the one that runs, and returns its port once it listens.
fn spawn() -> anyhow::Result<u16> {
    let options = SpawnOptions { memory_limit: VIEWER_MEMORY.to_owned(), ..SpawnOptions::default() };
    let port = match rerun::spawn(&options) {
        Ok(info) => info.port,
        Err(rerun::SpawnError::ExecutableNotFoundInPath { .. }) => {
            bail!("there is no viewer `rerun` on the PATH; {INSTALL}")
        }
        Err(error) => return Err(error).context("cannot start the viewer `rerun`"),
    };
    let started = Instant::now();
    while !listens(&url("127.0.0.1", port)) {
        if started.elapsed() > START_TIMEOUT {
            bail!("the viewer `rerun` did not start within {} s", START_TIMEOUT.as_secs());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(port)
}

fn listens(url: &str) -> bool {
    let addresses = Sink::address(url).and_then(|address| address.to_socket_addrs().ok());
    addresses.into_iter().flatten().any(|address| TcpStream::connect_timeout(&address, Duration::from_secs(1)).is_ok())
}

fn sequence(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// `/train/lce` and below it `parts`, which may hold any character.
fn entity<const N: usize>(topic: &str, parts: [&str; N]) -> EntityPath {
    let parts = topic.split('/').filter(|part| !part.is_empty()).chain(parts);
    EntityPath::new(parts.map(EntityPathPart::new).collect())
}

/// Ten colours that are easy to tell apart.
fn episode_colour(episode: u32) -> Color {
    const COLOURS: [[u8; 3]; 10] = [
        [102, 194, 255],
        [255, 159, 64],
        [120, 220, 120],
        [255, 99, 132],
        [186, 140, 255],
        [200, 160, 120],
        [255, 140, 220],
        [190, 190, 190],
        [220, 220, 90],
        [80, 220, 210],
    ];
    let [r, g, b] = COLOURS[episode as usize % COLOURS.len()];
    Color::from_rgb(r, g, b)
}
