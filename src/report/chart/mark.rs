//! The marks of a chart: levels, lines, bands and notes.

use super::{LEFT, Scale, svg::Picture};

/// The opacity of a band.
pub(super) const BAND_OPACITY: f64 = 0.17;

/// Something that a chart shows.
pub(super) enum Mark {
    /// A horizontal line across the chart.
    Level { y: f64, stroke: Stroke, name: String },
    /// A line through points. `name` is its entry in the legend.
    Line { points: Vec<[f64; 2]>, stroke: Stroke, has_dots: bool, name: Option<String> },
    /// A filled band; a bar where it has a single point.
    Band { points: Vec<BandPoint>, colour: &'static str, name: Option<String> },
    /// A remark in the legend.
    Note(String),
}

/// The ends of a band.
#[derive(Debug, Clone, Copy)]
pub(super) struct BandPoint {
    pub(super) x: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    pub(super) colour: &'static str,
    pub(super) width: f64,
    pub(super) opacity: f64,
    pub(super) dashes: &'static str,
}

impl Stroke {
    pub(super) const fn new(colour: &'static str, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dashes: "" }
    }

    pub(super) const fn dashed(self, dashes: &'static str) -> Self {
        Self { dashes, ..self }
    }

    pub(super) const fn faint(self) -> Self {
        Self { opacity: 0.35, ..self }
    }

    pub(super) fn style(self) -> String {
        let mut style = format!("stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"", self.colour, self.width);
        if self.opacity < 1.0 {
            style.push_str(&format!(" stroke-opacity=\"{}\"", self.opacity));
        }
        if !self.dashes.is_empty() {
            style.push_str(&format!(" stroke-dasharray=\"{}\"", self.dashes));
        }
        style
    }
}

impl Mark {
    /// The horizontal places of its points.
    pub(super) fn xs(&self) -> Vec<f64> {
        match self {
            Self::Line { points, .. } => points.iter().map(|[x, _]| *x).collect(),
            Self::Band { points, .. } => points.iter().map(|point| point.x).collect(),
            Self::Level { .. } | Self::Note(_) => Vec::new(),
        }
    }

    /// The vertical places of its points.
    pub(super) fn ys(&self) -> Vec<f64> {
        match self {
            Self::Level { y, .. } => vec![*y],
            Self::Line { points, .. } => points.iter().map(|[_, y]| *y).collect(),
            Self::Band { points, .. } => points.iter().flat_map(|point| [point.low, point.high]).collect(),
            Self::Note(_) => Vec::new(),
        }
    }

    pub(super) fn draw(&self, picture: &mut Picture, scale: &Scale) {
        match self {
            Self::Level { y, stroke, .. } => {
                let [_, y] = scale.place(0.0, *y);
                picture.line(&[[LEFT, y], [scale.right(), y]], &stroke.style());
            }
            Self::Line { points, stroke, has_dots, .. } => {
                let places: Vec<[f64; 2]> = points.iter().map(|[x, y]| scale.place(*x, *y)).collect();
                picture.line(&places, &stroke.style());
                if *has_dots {
                    places.iter().for_each(|place| picture.dot(*place, &format!("fill=\"{}\"", stroke.colour)));
                }
            }
            Self::Band { points, colour, .. } => {
                if let [BandPoint { x, low, high }] = points[..] {
                    let bar = [scale.place(x, low), scale.place(x, high)];
                    picture.line(&bar, &Stroke { opacity: 0.3, ..Stroke::new(colour, 5.0) }.style());
                } else {
                    let lower = points.iter().map(|point| scale.place(point.x, point.low));
                    let upper = points.iter().rev().map(|point| scale.place(point.x, point.high));
                    let outline: Vec<[f64; 2]> = lower.chain(upper).collect();
                    picture.area(&outline, &format!("fill=\"{colour}\" fill-opacity=\"{BAND_OPACITY}\""));
                }
            }
            Self::Note(_) => {}
        }
    }
}
