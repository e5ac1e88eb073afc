//! The layout of the view. The viewer's automatic layout changes from version to version, so the view sends its own.

use std::collections::BTreeMap;

use carl_pipe::record::topic;
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

/// The application's name in the viewer. Raise the number with every change of the layout: a viewer saves the last
/// layout of an application and prefers the saved one.
pub(crate) const APPLICATION: &str = "carl-pipe-v1";
/// A value that is smaller than the largest value of its topic by this factor is drawn in a separate plot.
const SMALL_FACTOR: f64 = 10.0;

/// What was learned from the messages about the layout: the dimensions of the latent space and the scales of curves.
#[derive(Debug, Default)]
pub(crate) struct Layout {
    /// True once a latent had a third dimension.
    is_3d: bool,
    /// The names of the small values of every topic of scalars so far.
    small: BTreeMap<String, Vec<String>>,
}

/// The topics whose curves have a plot of their own, with a second one for small values.
const PLOTTED: [&str; 5] =
    [topic::TRAIN_LCE, topic::TRAIN_SAC, topic::TRAIN_DISTILL, topic::TRAIN_SOLAR, topic::CONTROL_SOLAR];

impl Layout {
    /// Learns from the first message of a topic which of its values are small; true if that changes the layout.
    pub(crate) fn learn_scales(&mut self, topic: &str, names: &[String], values: &[f64]) -> bool {
        if self.small.contains_key(topic) {
            return false;
        }
        let size = |value: f64| if value.is_finite() { value.abs() } else { 0.0 };
        let largest = values.iter().fold(0.0, |largest: f64, &value| largest.max(size(value)));
        let named = names.iter().zip(values);
        let small: Vec<_> = named
            .filter(|&(_, &value)| value != 0.0 && size(value) * SMALL_FACTOR < largest)
            .map(|(name, _)| name.clone())
            .collect();
        let splits = PLOTTED.contains(&topic) && !small.is_empty();
        self.small.insert(topic.to_owned(), if splits { small } else { Vec::new() });
        splits
    }

    /// Learns whether latents have a third dimension; true if that changes the layout.
    pub(crate) fn learn_dimensions(&mut self, latents: &[[f32; 3]]) -> bool {
        let was_3d = self.is_3d;
        self.is_3d |= latents.iter().any(|&[_, _, z]| z != 0.0);
        self.is_3d != was_3d
    }

    /// True if the latent space is drawn in three dimensions.
    pub(crate) fn is_3d(&self) -> bool {
        self.is_3d
    }

    /// Sends the layout to the viewer, which applies it at once.
    pub(crate) fn send(&self, stream: &RecordingStream) -> anyhow::Result<()> {
        let mut plots = Plots::default();
        let blueprint = self.blueprint(&mut plots);
        // The SDK cannot set the properties of a plot, so they are logged into the blueprint as messages.
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
        let latents = Tabs::new([
            self.latent_map("latent space", topic::LATENT_MAP),
            self.latent_map("smoothed latents", topic::LATENT_SMOOTHED),
        ]);
        let spaces = Horizontal::new([latents.into(), true_space()]);
        let left = Vertical::new([spaces.into(), pictures.into()]).with_row_shares(vec![3.0, 2.0]);
        let rows = [
            plots.add("percent of time in goal", topic::PERCENT_GOAL, Vec::new(), Corner2D::RightBottom),
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

    fn latent_map(&self, title: &str, topic: &str) -> ContainerLike {
        let contents = all_but(topic, ["quality"]);
        if self.is_3d {
            Spatial3DView::new(title).with_origin(topic).with_contents(contents).into()
        } else {
            Spatial2DView::new(title).with_origin(topic).with_contents(contents).into()
        }
    }

    /// The plot of a topic's curves, with a second plot beside it for the small values.
    fn curves(&self, title: &str, topic: &str, plots: &mut Plots) -> ContainerLike {
        let small = self.small.get(topic).map_or(&[][..], Vec::as_slice);
        let large = plots.add(title, topic, all_but(topic, small.iter().map(String::as_str)), Corner2D::RightTop);
        if small.is_empty() {
            return large;
        }
        let contents = small.iter().map(|name| format!("+ {topic}/{name}/**")).collect();
        Horizontal::new([large, plots.add(&format!("{title}: small values"), topic, contents, Corner2D::RightTop)])
            .into()
    }

    /// The log, with tabs behind it for the curves that have no plot elsewhere.
    fn log(&self, plots: &mut Plots) -> ContainerLike {
        let mut rest = vec!["+ /**".to_owned()];
        let placed = PLOTTED.iter().chain(&[topic::PERCENT_GOAL]);
        rest.extend(placed.map(|topic| format!("- {topic}/**")));
        Tabs::new([
            TextLogView::new("log").with_contents(["+ /**"]).into(),
            self.curves("distillation", topic::TRAIN_DISTILL, plots),
            self.curves("SOLAR's model", topic::TRAIN_SOLAR, plots),
            self.curves("SOLAR's control", topic::CONTROL_SOLAR, plots),
            plots.add("other curves", "/", rest, Corner2D::RightTop),
        ])
        .into()
    }
}

/// The plots of a layout.
#[derive(Debug, Default)]
struct Plots(Vec<Plot>);

#[derive(Debug)]
struct Plot {
    path: EntityPath,
    /// The corner of the legend. The curves of the plot rarely go there.
    legend: Corner2D,
}

impl Plots {
    /// Adds a plot of these contents, or of the whole topic if `contents` is empty.
    fn add(&mut self, title: &str, topic: &str, contents: Vec<String>, legend: Corner2D) -> ContainerLike {
        let mut plot = TimeSeriesView::new(title).with_origin(topic);
        if !contents.is_empty() {
            plot = plot.with_contents(contents);
        }
        let plot = ContainerLike::from(plot);
        if let ContainerLike::View(view) = &plot {
            self.0.push(Plot { path: view.blueprint_path(), legend });
        }
        plot
    }

    /// Messages that place the legends and show the whole run on every time axis. By default the viewer shows a window
    /// around the time cursor.
    fn properties(&self, blueprint_id: &RecordingId) -> anyhow::Result<Vec<LogMsg>> {
        let builder = RecordingStreamBuilder::new(APPLICATION).recording_id(blueprint_id.clone());
        let (stream, messages) = builder.blueprint().memory()?;
        stream.set_time_sequence("blueprint", 0);
        let axis = TimeAxis::new().with_view_range(TimeRange(datatypes::TimeRange::EVERYTHING));
        for Plot { path, legend } in &self.0 {
            stream.log(format!("{path}/PlotLegend"), &PlotLegend::new().with_corner(*legend))?;
            stream.log(format!("{path}/TimeAxis"), &axis)?;
        }
        Ok(messages.take().into_iter().filter(|message| matches!(message, LogMsg::ArrowMsg(..))).collect())
    }
}

/// Selects the entities below a topic, without some of its values.
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
