//! A writer of the few SVG elements that charts need.

use std::fmt::Write as _;

/// The colour of text and of axes.
pub(super) const INK: &str = "#333";

/// An SVG picture to write into; [`Picture::end`] closes it.
pub(super) struct Picture(String);

impl Picture {
    /// A white picture.
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\" \
             font-size=\"12\" fill=\"{INK}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        ))
    }

    /// Words; `style` holds further attributes.
    pub(super) fn text(&mut self, [x, y]: [f64; 2], style: &str, words: &str) {
        // XML has no control characters, not even escaped.
        let words: String = words.chars().filter(|c| !c.is_control()).collect();
        let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let _ = writeln!(self.0, "<text x=\"{x:.1}\" y=\"{y:.1}\" {style}>{words}</text>");
    }

    /// A line through points.
    pub(super) fn line(&mut self, points: &[[f64; 2]], style: &str) {
        let _ = writeln!(self.0, "<polyline points=\"{}\" fill=\"none\" {style}/>", list(points));
    }

    /// A filled shape.
    pub(super) fn area(&mut self, points: &[[f64; 2]], style: &str) {
        let _ = writeln!(self.0, "<polygon points=\"{}\" {style}/>", list(points));
    }

    /// A dot.
    pub(super) fn dot(&mut self, [x, y]: [f64; 2], style: &str) {
        let _ = writeln!(self.0, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" {style}/>");
    }

    /// A circle without filling.
    pub(super) fn ring(&mut self, [x, y]: [f64; 2], radius: f64, style: &str) {
        let _ = writeln!(self.0, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"none\" {style}/>");
    }

    /// A path in the notation of SVG.
    pub(super) fn path(&mut self, path: &str, style: &str) {
        let _ = writeln!(self.0, "<path {style} d=\"{path}\"/>");
    }

    /// Begins a group; `style` holds for all until [`Picture::end_group`].
    pub(super) fn group(&mut self, style: &str) {
        let _ = writeln!(self.0, "<g {style}>");
    }

    pub(super) fn end_group(&mut self) {
        self.0.push_str("</g>\n");
    }

    /// The whole picture.
    pub(super) fn end(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }
}

fn list(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_cannot_break_a_picture() {
        let mut picture = Picture::new(1.0, 1.0);
        picture.text([0.0, 0.0], "", "a<b & c>\u{1b}");
        assert!(picture.end().contains(">a&lt;b &amp; c&gt;</text>"));
    }
}
