//! Draws messages with Rerun, as one tree of entities on the timelines `step`, `epoch` and `round`.
//!
//! The path of an entity is the topic, then the name of the value if the topic has several, then the node's lane.

use std::{collections::BTreeMap, time::Duration};

use carl_pipe::{
    cli::Sink,
    record::{Frame, Level, Message},
};
use rerun::{
    Color, EntityPath, EntityPathPart, Image, LineStrips2D, Points2D, Points3D, Radius, RecordingStream, Scalars,
    TextLog,
};

use crate::{
    blueprint::Layout,
    connect,
    host::ViewHost,
    style,
    viewer::{Position, Viewer},
};

/// How long the end of a view waits for a viewer. A viewer that hangs must not keep the process alive.
const VIEWER_FLUSH_TIMEOUT: Duration = Duration::from_secs(2);
const FILE_FLUSH_TIMEOUT: Duration = Duration::from_secs(60);

/// A Rerun viewer, or a file for one.
pub struct RerunViewer {
    stream: RecordingStream,
    sink: Sink,
    layout: Layout,
    /// The position of every curve's latest value.
    latest: BTreeMap<EntityPath, Position>,
}

impl std::fmt::Debug for RerunViewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RerunViewer").field("sink", &self.sink).finish_non_exhaustive()
    }
}

impl RerunViewer {
    /// Opens a sink and sends the layout.
    ///
    /// # Errors
    /// If no viewer can be started or reached, the port is taken, or the file cannot be written.
    pub fn open(sink: &Sink, host: &dyn ViewHost) -> anyhow::Result<RerunViewer> {
        let stream = connect::open(sink, host)?;
        let layout = Layout::default();
        layout.send(&stream)?;
        Ok(RerunViewer { stream, sink: sink.clone(), layout, latest: BTreeMap::new() })
    }

    fn set_time(&self, position: &Position) {
        self.stream.set_time_sequence("step", sequence(position.step));
        self.stream.set_time_sequence("epoch", sequence(position.epoch));
        self.stream.set_time_sequence("round", i64::from(position.round));
    }

    fn scalars(&mut self, position: &Position, topic: &str, names: &[String], values: &[f64]) -> anyhow::Result<()> {
        if self.layout.learn_scales(topic, names, values) {
            self.layout.send(&self.stream)?;
        }
        for (name, &value) in names.iter().zip(values) {
            let entity = entity(topic, [name.as_str(), &position.lane]);
            match self.latest.insert(entity.clone(), position.clone()) {
                None => self.style(&entity, topic, name, &position.lane)?,
                Some(last) if last.round != position.round && topic.starts_with("/train/") => {
                    self.break_curve(&entity, &last)?;
                    self.set_time(position);
                }
                Some(_) => {}
            }
            self.stream.log(entity, &Scalars::single(value))?;
        }
        Ok(())
    }

    fn style(&self, entity: &EntityPath, topic: &str, name: &str, lane: &str) -> anyhow::Result<()> {
        let style = style::curve(topic, name, lane);
        if let Some(points) = style.points {
            self.stream.log_static(entity.clone(), &points)?;
        }
        Ok(self.stream.log_static(entity.clone(), &style.lines)?)
    }

    /// Leaves a gap in a curve after its last value, so that no line joins the end of a round to the start of the next.
    fn break_curve(&self, entity: &EntityPath, last: &Position) -> anyhow::Result<()> {
        self.stream.reset_time();
        self.stream.set_time_sequence("step", sequence(last.step.saturating_add(1)));
        Ok(self.stream.log(entity.clone(), &Scalars::new(std::iter::empty::<f64>()))?)
    }

    /// Draws latents, in two dimensions until a latent has a third one.
    fn latents(
        &mut self,
        entity: EntityPath,
        latents: &[[f32; 3]],
        colours: &[Color],
        radius: f32,
    ) -> anyhow::Result<()> {
        if self.layout.learn_dimensions(latents) {
            self.layout.send(&self.stream)?;
        }
        let radius = Radius::new_ui_points(radius);
        let colours = colours.iter().copied();
        if self.layout.is_3d() {
            let points = Points3D::new(latents.iter().copied());
            Ok(self.stream.log(entity, &points.with_colors(colours).with_radii([radius]))?)
        } else {
            let points = Points2D::new(latents.iter().map(|&[x, y, _]| (x, y)));
            Ok(self.stream.log(entity, &points.with_colors(colours).with_radii([radius]))?)
        }
    }

    fn obstacles(&self, entity: EntityPath, circles: &[[f32; 3]]) -> anyhow::Result<()> {
        let discs = Points2D::new(circles.iter().map(|&[row, col, _]| (col, row)))
            .with_radii(circles.iter().map(|&[_, _, radius]| Radius::new_scene_units(radius)))
            .with_colors([style::colour(style::OBSTACLE)])
            .with_draw_order(-10.0);
        Ok(self.stream.log(entity, &discs)?)
    }

    fn trajectory(&self, position: &Position, topic: &str, frame: &Frame) -> anyhow::Result<()> {
        let Frame::Trajectory { episode, path, goal, radius, percent_goal } = frame else { return Ok(()) };
        let below = |part: &str| entity(topic, [position.lane.as_str(), &format!("episode {episode}"), part]);
        let colour = style::episode(*episode);
        let line = LineStrips2D::new([path.iter().map(|&[row, col]| (col, row)).collect::<Vec<_>>()]);
        self.stream.log(below("path"), &line.with_colors([colour]).with_radii([Radius::new_ui_points(1.5)]))?;
        let ends = [path.first(), path.last()].into_iter().flatten().map(|&[row, col]| (col, row));
        let ends = Points2D::new(ends).with_radii([Radius::new_ui_points(2.5), Radius::new_ui_points(4.0)]);
        self.stream.log(below("ends"), &ends.with_colors([colour]))?;
        let circle = LineStrips2D::new([circle(*goal, *radius)])
            .with_colors([style::colour(style::GOAL_CIRCLE)])
            .with_radii([Radius::new_ui_points(0.75)])
            .with_labels([format!("episode {episode}: {percent_goal:.0} %")])
            .with_show_labels(false);
        Ok(self.stream.log(below("goal"), &circle)?)
    }
}

impl Viewer for RerunViewer {
    fn title(&mut self, title: &str) -> anyhow::Result<()> {
        Ok(self.stream.send_recording_name(title)?)
    }

    fn show(&mut self, position: &Position, message: &Message) -> anyhow::Result<()> {
        self.set_time(position);
        let topic = message.topic.as_str();
        let here = entity(topic, [position.lane.as_str()]);
        match &message.frame {
            Frame::Scalars { names, values } => self.scalars(position, topic, names, values),
            Frame::LatentMap { latents, colours, .. } => {
                let colours: Vec<_> = colours.iter().map(|&[r, g, b, _]| style::colour([r, g, b])).collect();
                self.latents(here, latents, &colours, 2.5)
            }
            Frame::Goals(goals) => self.latents(here, goals, &[style::colour(style::GOAL)], 6.0),
            Frame::Obstacles(circles) => self.obstacles(here, circles),
            Frame::Picture { height, width, bytes } => {
                let is_grey = u64::from(*height) * u64::from(*width) == bytes.len() as u64;
                let (bytes, size) = (bytes.clone(), [*width, *height]);
                let image = if is_grey { Image::from_l8(bytes, size) } else { Image::from_rgb24(bytes, size) };
                Ok(self.stream.log(here, &image)?)
            }
            Frame::Trajectory { .. } => self.trajectory(position, topic, &message.frame),
            Frame::Log { level, text } => {
                Ok(self.stream.log(here, &TextLog::new(text.as_str()).with_level(rerun_level(*level)))?)
            }
        }
    }

    fn close(&mut self, host: &dyn ViewHost) -> anyhow::Result<()> {
        if let Sink::Serve { .. } = self.sink {
            host.note("everything is shown; serving until interrupted");
            while !host.should_stop() {
                std::thread::sleep(Duration::from_millis(100));
            }
            return Ok(());
        }
        let is_file = matches!(self.sink, Sink::Save { .. });
        let timeout = if is_file { FILE_FLUSH_TIMEOUT } else { VIEWER_FLUSH_TIMEOUT };
        if let Err(error) = self.stream.flush_with_timeout(timeout) {
            host.note(&format!("the viewer may not have received everything: {error}"));
        }
        if let Sink::Save { path } = &self.sink {
            self.stream.disconnect();
            host.note(&format!("wrote {}; open it with `rerun {}`", path.display(), path.display()));
        }
        Ok(())
    }
}

impl Drop for RerunViewer {
    /// Leaks a stream towards a viewer. If the viewer hangs, dropping the stream would hang too; the process is about
    /// to end anyway.
    fn drop(&mut self) {
        if !matches!(self.sink, Sink::Save { .. }) {
            std::mem::forget(std::mem::replace(&mut self.stream, RecordingStream::disabled()));
        }
    }
}

/// The points of a circle in true space, as column and row.
fn circle([row, col]: [f32; 2], radius: f32) -> Vec<(f32, f32)> {
    const CORNERS: u32 = 48;
    let corner = |i: u32| {
        let angle = f64::from(i) / f64::from(CORNERS) * std::f64::consts::TAU;
        (col + radius * angle.cos() as f32, row + radius * angle.sin() as f32)
    };
    (0..=CORNERS).map(corner).collect()
}

fn rerun_level(level: Level) -> &'static str {
    match level {
        Level::Debug => "DEBUG",
        Level::Info => "INFO",
        Level::Warning => "WARN",
        Level::Error => "ERROR",
    }
}

fn sequence(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// The path of an entity: a topic such as `/train/lce`, then `parts`, which may hold any character.
fn entity<const N: usize>(topic: &str, parts: [&str; N]) -> EntityPath {
    let parts = topic.split('/').filter(|part| !part.is_empty()).chain(parts);
    EntityPath::new(parts.map(EntityPathPart::new).collect())
}
