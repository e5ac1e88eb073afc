//! The legend of a chart: names of its marks, one below the other.

use super::{
    mark::{BAND_OPACITY, Mark, Stroke},
    svg::{INK, Picture},
};

/// Height of a line of text.
const LINE: f64 = 17.0;
/// The length of the sample of a mark.
const SAMPLE: f64 = 20.0;
/// The mean width of a letter.
const LETTER: f64 = 7.6;

pub(super) struct Legend {
    x: f64,
    y: f64,
    /// The number of letters that fit on a line.
    letters: usize,
}

impl Legend {
    pub(super) fn new(x: f64, y: f64, width: f64) -> Self {
        Self { x, y, letters: ((width - SAMPLE - 6.0) / LETTER) as usize }
    }

    /// Adds a mark, if it has a name.
    pub(super) fn entry(&mut self, picture: &mut Picture, mark: &Mark) {
        match mark {
            Mark::Level { stroke, name, .. } | Mark::Line { stroke, name: Some(name), .. } => {
                self.sample(picture, *stroke, name);
            }
            Mark::Band { colour, name: Some(name), .. } => {
                self.sample(picture, Stroke { opacity: BAND_OPACITY, ..Stroke::new(colour, 11.0) }, name);
            }
            Mark::Note(words) => picture.text([self.x, self.y + 8.0], &format!("fill=\"{INK}\""), words),
            Mark::Line { name: None, .. } | Mark::Band { name: None, .. } => {}
        }
    }

    fn sample(&mut self, picture: &mut Picture, stroke: Stroke, name: &str) {
        picture.line(&[[self.x, self.y], [self.x + SAMPLE, self.y]], &stroke.style());
        for line in lines(name, self.letters) {
            picture.text([self.x + SAMPLE + 6.0, self.y + 4.0], "", line);
            self.y += LINE;
        }
    }
}

/// Breaks words into lines of at most so many letters, at spaces where there are any.
fn lines(words: &str, letters: usize) -> Vec<&str> {
    let (mut lines, mut rest) = (Vec::new(), words.trim());
    while let Some((most, _)) = rest.char_indices().nth(letters.max(1)) {
        let end = rest[..most].rfind(' ').unwrap_or(most);
        lines.push(rest[..end].trim());
        rest = rest[end..].trim_start();
    }
    lines.push(rest);
    lines
}

#[cfg(test)]
mod tests {
    #[test]
    fn long_names_break_at_spaces() {
        assert_eq!(super::lines("one two three", 8), ["one two", "three"]);
        assert_eq!(super::lines("one", 8), ["one"]);
        assert_eq!(super::lines("unbreakable", 8), ["unbreaka", "ble"]);
    }
}
