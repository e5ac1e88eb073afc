//! Colours and names of what the view draws.

use carl_pipe::record::topic;
use rerun::{Color, SeriesLines, SeriesPoints};

/// Red, green and blue.
type Rgb = [u8; 3];

/// The colour of a goal among the latents of known states.
pub(crate) const GOAL: Rgb = [255, 255, 255];
/// The colour of obstacles in true space.
pub(crate) const OBSTACLE: Rgb = [90, 90, 100];
/// The colour of the circle around an episode's goal.
pub(crate) const GOAL_CIRCLE: Rgb = [230, 230, 230];

/// The colour as Rerun takes it.
pub(crate) fn colour([r, g, b]: Rgb) -> Color {
    Color::from_rgb(r, g, b)
}

/// The lines of a curve, and the points of curves that may have one value only.
pub(crate) struct CurveStyle {
    pub(crate) lines: SeriesLines,
    pub(crate) points: Option<SeriesPoints>,
}

/// The style of the curve `name` of a topic. The legend names the point of the matrix, if the lane has one.
pub(crate) fn curve(topic: &str, name: &str, lane: &str) -> CurveStyle {
    let legend = match lane.split_once('[') {
        Some((_, point)) => format!("{name} {}", point.trim_end_matches(']')),
        None => name.to_owned(),
    };
    let lines = SeriesLines::new().with_names([legend.as_str()]).with_widths([1.5]);
    if topic != topic::PERCENT_GOAL {
        return CurveStyle { lines, points: None };
    }
    let colour = colour(match name {
        "percent_goal" => [255, 200, 60],
        "policy_alone" => [220, 70, 140],
        "paper" => [150, 150, 150],
        _ => [90, 160, 255],
    });
    // A run of one round gives one value, which a line alone would not show.
    let points = SeriesPoints::new().with_names([legend.as_str()]).with_colors([colour]).with_marker_sizes([4.0]);
    CurveStyle { lines: lines.with_colors([colour]), points: Some(points) }
}

/// One of ten colours that are easy to tell apart.
pub(crate) fn episode(episode: u32) -> Color {
    const COLOURS: [Rgb; 10] = [
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
    colour(COLOURS[episode as usize % COLOURS.len()])
}
