//! The layout of the Rerun view: ours, never the viewer's guess, which changes from version to version.

use std::collections::BTreeMap;

use rerun::{
    EntityPath, RecordingStream, RecordingStreamBuilder, StoreKind,
    blueprint::{
        Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView,
        Spatial3DView, Tabs, TextLogView, TimePanel, TimeSeriesView, Vertical,
        components::{Corner2D, PanelState, PlayState, TimeRange},
    },
    external::{
        re_log_types::{LogMsg, RecordingId},
        re_sdk_types::{
            blueprint::archetypes::{PlotLegend, TimeAxis},
            datatypes,
        },
    },
};

use super::topic;

/// Raised with every change of the layout: viewers keep the last layout of an application and prefer it to ours.
pub(super) const APPLICATION: &str = "carl-pipe-v1";
/// Values this much smaller than the largest of their topic get a plot of their own.
const OTHER_SCALE: f64 = 10.0;

/// What the layout depends on: how many dimensions the latent space has, and which curves are small.
#[derive(Debug, Default)]
pub(super) struct Layout {
    /// The latent map is drawn in three dimensions.
    pub solid: bool,
    /// The small values of every topic of scalars seen so far.
    small: BTreeMap<String, Vec<String>>,
}

impl Layout {
    /// Learns of a topic by its first message; true if that changes the layout.
    pub(super) fn sees(&mut self, topic: &str, names: &[String], values: &[f64]) -> bool {
        if self.small.contains_key(topic) {
            return false;
        }
        let size = |value: f64| if value.is_finite() { value.abs() } else { 0.0 };
        let largest = values.iter().fold(0.0, |largest: f64, &value| largest.max(size(value)));
        let named = names.iter().zip(values);
        let small: Vec<_> = named
            .filter(|&(_, &value)| value != 0.0 && size(value) * OTHER_SCALE < largest)
            .map(|(name, _)| name.clone())
            .collect();
        let splits = [topic::TRAIN_LCE, topic::TRAIN_SAC, topic::TRAIN_DISTILL].contains(&topic) && !small.is_empty();
        self.small.insert(topic.to_owned(), if splits { small } else { Vec::new() });
        splits
    }

    /// Looks at latents; true if they are the first with a third dimension, which changes the layout.
    pub(super) fn latents_have_depth(&mut self, latents: &[[f32; 3]]) -> bool {
        let was = self.solid;
        self.solid |= latents.iter().any(|latent| latent[2] != 0.0);
        self.solid != was
    }

    /// Sends the layout to the viewer, which takes it up at once.
    pub(super) fn send(&self, stream: &RecordingStream) -> anyhow::Result<()> {
        let mut plots = Plots::default();
        let blueprint = self.blueprint(&mut plots);
        // The SDK has no way to set the properties of a plot, so they are logged into the blueprint beside it.
        let (layout, messages) = RecordingStreamBuilder::new(APPLICATION).memory()?;
        blueprint.send(&layout, BlueprintActivation::default())?;
        let is_layout = |message: &LogMsg| message.store_id().kind() == StoreKind::Blueprint;
        let mut messages: Vec<_> = messages.take().into_iter().filter(is_layout).collect();
        let activation = messages.pop_if(|message| matches!(message, LogMsg::BlueprintActivationCommand(_)));
        if let Some(LogMsg::BlueprintActivationCommand(activation)) = activation {
            messages.extend(plots.properties(activation.blueprint_id.recording_id())?);
            stream.send_blueprint(messages, activation);
        }
        Ok(())
    }

    fn blueprint(&self, plots: &mut Plots) -> Blueprint {
        let pictures = Horizontal::new([
            picture("observation", topic::PICTURE_OBSERVATION),
            picture("reconstruction", topic::PICTURE_RECONSTRUCTION),
            picture("prediction", topic::PICTURE_PREDICTION),
        ]);
        let spaces = Horizontal::new([self.latent_map(), true_space()]);
        let left = Vertical::new([spaces.into(), pictures.into()]).with_row_shares(vec![3.0, 2.0]);
        let rows = [
            plots.of("percent of time in goal", topic::PERCENT_GOAL, Vec::new(), Corner2D::RightBottom),
            self.curves("latent model", topic::TRAIN_LCE, plots),
            self.curves("SAC", topic::TRAIN_SAC, plots),
            self.log(plots),
        ];
        let right = Vertical::new(rows).with_row_shares(vec![4.0, 4.0, 4.0, 3.0]);
        let root = Horizontal::new([left.into(), right.into()]).with_column_shares(vec![1.0, 1.0]);
        Blueprint::new(root)
            .with_auto_layout(false)
            .with_auto_views(false)
            .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
            .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
            .with_time_panel(
                TimePanel::new()
                    .with_state(PanelState::Collapsed)
                    .with_timeline("step")
                    .with_play_state(PlayState::Following),
            )
    }

    fn latent_map(&self) -> ContainerLike {
        let contents = all_but(topic::LATENT_MAP, ["quality"]);
        if self.solid {
            Spatial3DView::new("latent space").with_origin(topic::LATENT_MAP).with_contents(contents).into()
        } else {
            Spatial2DView::new("latent space").with_origin(topic::LATENT_MAP).with_contents(contents).into()
        }
    }

    /// A topic's curves; the small ones beside the others.
    fn curves(&self, title: &str, topic: &str, plots: &mut Plots) -> ContainerLike {
        let small = self.small.get(topic).map_or(&[][..], Vec::as_slice);
        let large = plots.of(title, topic, all_but(topic, small.iter().map(String::as_str)), Corner2D::RightTop);
        if small.is_empty() {
            return large;
        }
        let contents = small.iter().map(|name| format!("+ {topic}/{name}/**")).collect();
        Horizontal::new([large, plots.of(&format!("{title}: small values"), topic, contents, Corner2D::RightTop)])
            .into()
    }

    /// The log, and behind it the curves that have no other place.
    fn log(&self, plots: &mut Plots) -> ContainerLike {
        let mut rest = vec!["+ /**".to_owned()];
        let placed = [topic::PERCENT_GOAL, topic::TRAIN_LCE, topic::TRAIN_SAC, topic::TRAIN_DISTILL];
        rest.extend(placed.iter().map(|topic| format!("- {topic}/**")));
        Tabs::new([
            TextLogView::new("log").with_contents(["+ /**"]).into(),
            self.curves("distillation", topic::TRAIN_DISTILL, plots),
            plots.of("other curves", "/", rest, Corner2D::RightTop),
        ])
        .into()
    }
}

/// The plots of a layout, each with the corner that its curves leave to the legend.
#[derive(Debug, Default)]
struct Plots(Vec<(EntityPath, Corner2D)>);

impl Plots {
    /// A plot of these contents, or of the whole topic.
    fn of(&mut self, title: &str, topic: &str, contents: Vec<String>, legend: Corner2D) -> ContainerLike {
        let mut plot = TimeSeriesView::new(title).with_origin(topic);
        if !contents.is_empty() {
            plot = plot.with_contents(contents);
        }
        let plot = ContainerLike::from(plot);
        if let ContainerLike::View(view) = &plot {
            self.0.push((view.blueprint_path(), legend));
        }
        plot
    }

    /// Legends, and the whole run on every time axis: left to itself, the viewer shows
    /// a window around the time cursor.
    fn properties(&self, blueprint_id: &RecordingId) -> anyhow::Result<Vec<LogMsg>> {
        let builder = RecordingStreamBuilder::new(APPLICATION).recording_id(blueprint_id.clone());
        let (stream, messages) = builder.blueprint().memory()?;
        stream.set_time_sequence("blueprint", 0);
        let axis = TimeAxis::new().with_view_range(TimeRange(datatypes::TimeRange::EVERYTHING));
        for (plot, legend) in &self.0 {
            stream.log(format!("{plot}/PlotLegend"), &PlotLegend::new().with_corner(*legend))?;
            stream.log(format!("{plot}/TimeAxis"), &axis)?;
        }
        Ok(messages.take().into_iter().filter(|message| matches!(message, LogMsg::ArrowMsg(..))).collect())
    }
}

fn all_but<'a>(topic: &str, without: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut contents = vec![format!("+ {topic}/**")];
    contents.extend(without.into_iter().map(|name| format!("- {topic}/{name}/**")));
    contents
}

fn picture(title: &str, topic: &str) -> ContainerLike {
    Spatial2DView::new(title).with_origin(topic).into()
}

fn true_space() -> ContainerLike {
    let contents = [format!("+ {}/**", topic::OBSTACLES), format!("+ {}/**", topic::TRAJECTORY)];
    Spatial2DView::new("true space: evaluated episodes").with_origin("/evaluate").with_contents(contents).into()
}
