//! Latent maps side by side, round by round.

use std::fmt::Write as _;

use super::svg::Picture;
use crate::artifact::LatentMap;

/// The most panels.
const PANELS: usize = 5;
/// The side of a panel.
const SIDE: f64 = 220.0;
const GAP: f64 = 16.0;
/// Where panels begin, below the title and the rounds.
const TOP: f64 = 62.0;
const BELOW: f64 = 34.0;

/// Which of `count` maps are shown: the first, the last and some evenly between.
pub(super) fn shown(count: usize) -> Vec<usize> {
    let panels = count.min(PANELS);
    let steps = panels.saturating_sub(1).max(1);
    (0..panels).map(|at| (at * (count - 1) + steps / 2) / steps).collect()
}

/// Draws the maps of these rounds.
pub(super) fn draw(title: &str, panels: &[(u32, LatentMap)]) -> String {
    // A strip of one or two panels still has room for its title.
    let width = GAP + panels.len().max(2) as f64 * (SIDE + GAP);
    let mut picture = Picture::new(width, TOP + SIDE + BELOW);
    picture.text([GAP, 26.0], "font-size=\"15\" font-weight=\"bold\"", title);
    for (at, (round, map)) in panels.iter().enumerate() {
        let left = GAP + at as f64 * (SIDE + GAP);
        let middle = left + SIDE / 2.0;
        picture.text([middle, TOP - 8.0], "text-anchor=\"middle\" font-size=\"13\"", &format!("round {round}"));
        let scale = SIDE / f64::from(LatentMap::SVG_SIDE);
        let _ = write!(
            picture.0,
            "<g class=\"panel\" transform=\"translate({left:.1} {TOP:.1}) scale({scale:.4})\">\n{}</g>\n\
             <rect x=\"{left:.1}\" y=\"{TOP:.1}\" width=\"{SIDE:.1}\" height=\"{SIDE:.1}\" fill=\"none\" \
             stroke=\"#ccc\"/>\n",
            map.svg_drawing()
        );
        let quality = format!("R² {:.3}", map.quality);
        picture.text([middle, TOP + SIDE + 20.0], "text-anchor=\"middle\"", &quality);
    }
    picture.end()
}

#[cfg(test)]
mod tests {
    use super::shown;

    #[test]
    fn the_first_and_the_last_map_are_shown_and_some_between() {
        assert_eq!(shown(1), [0]);
        assert_eq!(shown(3), [0, 1, 2]);
        assert_eq!(shown(17), [0, 4, 8, 12, 16]);
        assert_eq!(shown(7), [0, 2, 3, 5, 6]);
    }
}
