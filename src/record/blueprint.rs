//! The layout of the Rerun view: ours, never the viewer's guess, which changes from version to version.

use std::collections::BTreeMap;

use rerun::blueprint::{
    Blueprint, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView, Spatial3DView, Tabs,
    TextLogView, TimePanel, TimeSeriesView, Vertical,
    components::{PanelState, PlayState},
};

use super::topic;

/// Values this much smaller than the largest of their topic get a plot of their own.
const OTHER_SCALE: f64 = 30.0;

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
        let small: Vec<_> =
            named.filter(|&(_, &value)| size(value) * OTHER_SCALE < largest).map(|(name, _)| name.clone()).collect();
        let splits = TRAIN.iter().any(|(known, _)| *known == topic) && !small.is_empty();
        self.small.insert(topic.to_owned(), if splits { small } else { Vec::new() });
        splits
    }

    /// Looks at latents; true if they are the first with a third dimension, which changes the layout.
    pub(super) fn latents_have_depth(&mut self, latents: &[[f32; 3]]) -> bool {
        let was = self.solid;
        self.solid |= latents.iter().any(|latent| latent[2] != 0.0);
        self.solid != was
    }

    pub(super) fn blueprint(&self) -> Blueprint {
        let pictures = Horizontal::new([
            picture("observation", topic::PICTURE_OBSERVATION),
            picture("reconstruction", topic::PICTURE_RECONSTRUCTION),
            picture("prediction", topic::PICTURE_PREDICTION),
        ]);
        let spaces = Horizontal::new([self.latent_map(), true_space()]);
        let left = Vertical::new([spaces.into(), pictures.into()]).with_row_shares(vec![3.0, 2.0]);
        let right = Vertical::new([percent_goal(), self.curves(), log()]).with_row_shares(vec![2.0, 5.0, 2.0]);
        let root = Horizontal::new([left.into(), right.into()]).with_column_shares(vec![5.0, 4.0]);
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

    fn curves(&self) -> ContainerLike {
        let mut rows: Vec<ContainerLike> = Vec::new();
        for (topic, title) in TRAIN {
            let small = self.small.get(topic).map_or(&[][..], Vec::as_slice);
            let contents = all_but(topic, small.iter().map(String::as_str));
            rows.push(TimeSeriesView::new(title).with_origin(topic).with_contents(contents).into());
            if !small.is_empty() {
                let contents = small.iter().map(|name| format!("+ {topic}/{name}/**"));
                rows.push(
                    TimeSeriesView::new(format!("{title}, small")).with_origin(topic).with_contents(contents).into(),
                );
            }
        }
        Vertical::new(rows).into()
    }
}

const TRAIN: [(&str, &str); 3] =
    [(topic::TRAIN_LCE, "latent model"), (topic::TRAIN_SAC, "SAC"), (topic::TRAIN_DISTILL, "distillation")];

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

fn percent_goal() -> ContainerLike {
    TimeSeriesView::new("percent in goal, by round on timeline `round`").with_origin(topic::PERCENT_GOAL).into()
}

/// The log, and behind it every curve that has no place of its own.
fn log() -> ContainerLike {
    let mut rest = vec!["+ /**".to_owned(), format!("- {}/**", topic::PERCENT_GOAL)];
    rest.extend(TRAIN.iter().map(|(topic, _)| format!("- {topic}/**")));
    Tabs::new([
        TextLogView::new("log").with_contents(["+ /**"]).into(),
        TimeSeriesView::new("other curves").with_contents(rest).into(),
    ])
    .into()
}
