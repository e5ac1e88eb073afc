//! Charts as SVG: learning curves by round or by samples, and latent maps.
//!
//! [`Chart`] is the one kind of chart with axes; the modules below say what goes into it.

mod axis;
mod latent_maps;
mod legend;
mod mark;
mod rounds;
mod samples;
mod svg;

pub use latent_maps::{Panel, latent_maps, shown};
pub use rounds::by_round;
pub use samples::{Band, by_samples};

use axis::Axis;
use legend::Legend;
use mark::{BandPoint, Mark, Stroke};
use svg::{INK, Picture};

/// The colour of the best possible controller's mean.
const CEILING: &str = "#2c7a4b";

/// A chart with two axes, and its legend to the right.
struct Chart {
    title: String,
    /// What the horizontal axis shows.
    x_label: &'static str,
    /// What the vertical axis shows.
    y_label: String,
    /// The greatest number of ticks of the horizontal axis.
    x_ticks: usize,
    /// The least and the greatest value that the vertical axis may show.
    y_limits: Option<[f64; 2]>,
    /// Width and height of the axes.
    size: [f64; 2],
    /// Width of the legend.
    legend: f64,
    /// What is drawn, from back to front. The legend has the same order.
    marks: Vec<Mark>,
}

/// The place of the axes in a picture.
const LEFT: f64 = 62.0;
const TOP: f64 = 52.0;
const BELOW: f64 = 52.0;
/// The first and the last point keep clear of the frame.
const INSET: f64 = 14.0;

/// The mapping from values to the picture.
struct Scale {
    x: Axis,
    y: Axis,
    size: [f64; 2],
}

impl Scale {
    fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let [width, height] = self.size;
        [LEFT + INSET + self.x.share(x) * (width - 2.0 * INSET), TOP + (1.0 - self.y.share(y)) * height]
    }

    fn right(&self) -> f64 {
        LEFT + self.size[0]
    }

    fn bottom(&self) -> f64 {
        TOP + self.size[1]
    }
}

impl Chart {
    /// The chart as SVG.
    fn draw(&self) -> String {
        let [width, height] = self.size;
        let mut picture = Picture::new(LEFT + width + self.legend, TOP + height + BELOW);
        picture.text([LEFT, 28.0], "font-size=\"16\" font-weight=\"bold\"", &self.title);
        let scale = self.scale();
        self.frame(&mut picture, &scale);
        let mut legend = Legend::new(scale.right() + 16.0, TOP + 6.0, self.legend - 16.0);
        for mark in &self.marks {
            mark.draw(&mut picture, &scale);
            legend.entry(&mut picture, mark);
        }
        picture.end()
    }

    /// Axes that hold all marks.
    fn scale(&self) -> Scale {
        let x = self.marks.iter().flat_map(Mark::xs);
        let y = self.marks.iter().flat_map(Mark::ys);
        Scale { x: Axis::exact(x, self.x_ticks), y: Axis::rounded(y, self.y_limits), size: self.size }
    }

    /// The grid, ticks and labels.
    fn frame(&self, picture: &mut Picture, scale: &Scale) {
        let (right, bottom) = (scale.right(), scale.bottom());
        for tick in &scale.y.ticks {
            let [_, y] = scale.place(0.0, *tick);
            picture.line(&[[LEFT, y], [right, y]], "stroke=\"#e8e8e8\"");
            picture.text([LEFT - 9.0, y + 4.0], "text-anchor=\"end\"", &axis::number(*tick));
        }
        for tick in &scale.x.ticks {
            let [x, _] = scale.place(*tick, 0.0);
            picture.line(&[[x, bottom], [x, bottom + 5.0]], &format!("stroke=\"{INK}\""));
            picture.text([x, bottom + 19.0], "text-anchor=\"middle\"", &axis::number(*tick));
        }
        picture.line(&[[LEFT, TOP], [LEFT, bottom], [right, bottom]], &format!("stroke=\"{INK}\""));
        let [x, y] = [f64::midpoint(LEFT, right), f64::midpoint(TOP, bottom)];
        picture.text([x, bottom + 40.0], "text-anchor=\"middle\" font-size=\"13\"", self.x_label);
        let turned = format!("text-anchor=\"middle\" font-size=\"13\" transform=\"rotate(-90 18 {y:.1})\"");
        picture.text([18.0, y], &turned, &self.y_label);
    }
}

/// The label and the limits of the vertical axis for a metric.
fn vertical(metric: &str) -> (String, Option<[f64; 2]>) {
    match metric {
        "percent_goal" => ("states at the goal, %".to_owned(), Some([0.0, 100.0])),
        _ => (metric.to_owned(), None),
    }
}
