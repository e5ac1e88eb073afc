//! Latent maps side by side, round by round.
//!
//! A map has a thousand points and more. Coordinates are whole tenths of a pixel, and points of similar colours share
//! one path, so that the picture stays small.

use std::{collections::BTreeMap, fmt::Write as _};

use super::svg::Picture;
use crate::artifact::LatentMap;

/// The greatest number of panels.
const PANELS: usize = 5;
/// The side of a panel.
const SIDE: f64 = 220.0;
const GAP: f64 = 16.0;
/// The room within a panel around its points.
const MARGIN: f64 = 11.0;
/// The top of the panels, below the title and the rounds.
const TOP: f64 = 62.0;
const BELOW: f64 = 34.0;
/// Units of a path in a pixel.
const UNITS: f64 = 10.0;
/// The number of shades that each colour channel is rounded to.
const SHADES: u16 = 16;

/// The latent map of one round.
#[derive(Debug)]
pub struct Panel {
    /// The round.
    pub round: u32,
    /// The map.
    pub map: LatentMap,
}

/// The indices of the maps to show out of `count`: the first, the last and some evenly between.
pub fn shown(count: usize) -> Vec<usize> {
    let panels = count.min(PANELS);
    let steps = panels.saturating_sub(1).max(1);
    (0..panels).map(|at| (at * (count - 1) + steps / 2) / steps).collect()
}

/// Draws latent maps side by side: the first two latent coordinates, where neighbours on the grid of states are joined.
/// Circles are goals.
pub fn latent_maps(title: &str, panels: &[Panel]) -> String {
    // A single panel still has room for its title.
    let width = GAP + panels.len().max(2) as f64 * (SIDE + GAP);
    let mut picture = Picture::new(width, TOP + SIDE + BELOW);
    picture.text([GAP, 26.0], "font-size=\"15\" font-weight=\"bold\"", title);
    for (at, Panel { round, map }) in panels.iter().enumerate() {
        let left = GAP + at as f64 * (SIDE + GAP);
        let middle = left + SIDE / 2.0;
        picture.text([middle, TOP - 8.0], "text-anchor=\"middle\" font-size=\"13\"", &format!("round {round}"));
        picture.group(&format!("class=\"panel\" transform=\"translate({left} {TOP}) scale({})\"", 1.0 / UNITS));
        draw(&mut picture, map);
        picture.end_group();
        let corners = [[left, TOP], [left + SIDE, TOP], [left + SIDE, TOP + SIDE], [left, TOP + SIDE]];
        picture.area(&corners, "fill=\"none\" stroke=\"#ccc\"");
        picture.text([middle, TOP + SIDE + 20.0], "text-anchor=\"middle\"", &format!("R² {:.3}", map.quality));
    }
    picture.end()
}

/// Draws the lines, states and goals of one map.
fn draw(picture: &mut Picture, map: &LatentMap) {
    let place = |code: &[f32]| [0, 1].map(|dimension| unit(map, code, dimension));
    let states: Vec<[i32; 2]> = map.codes.chunks(map.latent).map(place).collect();
    let goals: Vec<[i32; 2]> = map.goals.chunks(map.latent).map(place).collect();
    picture.path(&lines(&map.grid, &states), "fill=\"none\" stroke=\"#bbb\" stroke-width=\"3\"");
    picture.group("fill=\"none\" stroke-width=\"28\" stroke-linecap=\"round\"");
    let mut by_colour: BTreeMap<[u8; 3], Vec<[i32; 2]>> = BTreeMap::new();
    for (colour, state) in map.colours.iter().zip(&states) {
        by_colour.entry(colour.map(shade)).or_default().push(*state);
    }
    for ([red, green, blue], states) in by_colour {
        picture.path(&dots(&states), &format!("stroke=\"#{red:02x}{green:02x}{blue:02x}\""));
    }
    picture.end_group();
    for [x, y] in goals {
        picture.ring([f64::from(x), f64::from(y)], 41.0, "stroke=\"#000\" stroke-width=\"11\"");
    }
}

/// The place of a code in one dimension, in units of a path.
fn unit(map: &LatentMap, code: &[f32], dimension: usize) -> i32 {
    let Some(axis) = map.axes.get(dimension) else { return (UNITS * SIDE / 2.0) as i32 };
    let share = f64::from(code[dimension] - axis.low) / f64::from(axis.high - axis.low).max(1e-6);
    (UNITS * (MARGIN + share * (SIDE - 2.0 * MARGIN))).round() as i32
}

/// The nearest of the shades.
fn shade(channel: u8) -> u8 {
    let step = 255 / (SHADES - 1);
    ((u16::from(channel) + step / 2) / step * step) as u8
}

/// A path along the rows and the columns of the grid.
fn lines(grid: &[[u32; 2]], states: &[[i32; 2]]) -> String {
    let along_rows: BTreeMap<[u32; 2], [i32; 2]> = grid.iter().copied().zip(states.iter().copied()).collect();
    let along_columns = along_rows.iter().map(|([row, column], state)| ([*column, *row], *state)).collect();
    let mut path = Path::default();
    for cells in [along_rows, along_columns] {
        let mut last = None;
        for ([line, at], state) in cells {
            if last == Some([line, at.wrapping_sub(1)]) {
                path.line_to(state)
            } else {
                path.move_to(state)
            }
            last = Some([line, at]);
        }
    }
    path.text
}

/// A path of dots: lines of no length, which have round ends.
fn dots(states: &[[i32; 2]]) -> String {
    let mut path = Path::default();
    for state in states {
        path.move_to(*state);
        path.text.push_str("h0");
    }
    path.text
}

/// A path in relative coordinates, which are shorter.
#[derive(Default)]
struct Path {
    text: String,
    at: [i32; 2],
}

impl Path {
    fn move_to(&mut self, to: [i32; 2]) {
        self.step('m', to);
    }

    fn line_to(&mut self, to: [i32; 2]) {
        self.step('l', to);
    }

    fn step(&mut self, letter: char, to: [i32; 2]) {
        let [dx, dy] = [to[0] - self.at[0], to[1] - self.at[1]];
        let gap = if dy < 0 { "" } else { " " };
        let _ = write!(self.text, "{letter}{dx}{gap}{dy}");
        self.at = to;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_and_the_last_map_are_shown_and_some_between() {
        assert_eq!(shown(1), [0]);
        assert_eq!(shown(3), [0, 1, 2]);
        assert_eq!(shown(17), [0, 4, 8, 12, 16]);
        assert_eq!(shown(7), [0, 2, 3, 5, 6]);
    }

    #[test]
    fn lines_join_neighbours_and_leave_gaps_open() {
        // A full square, and a cell that touches it at a corner alone.
        let grid = [[0, 0], [0, 1], [1, 0], [1, 1], [2, 2]];
        let states = [[0, 0], [10, 0], [0, 10], [10, 10], [20, 20]];
        assert_eq!(lines(&grid, &states), "m0 0l10 0m-10 10l10 0m10 10m-20-20l0 10m10-10l0 10m10 10");
    }

    #[test]
    fn a_dot_is_a_line_of_no_length() {
        assert_eq!(dots(&[[5, 7], [4, 9]]), "m5 7h0m-1 2h0");
        assert_eq!([0, 127, 255].map(shade), [0, 119, 255]);
    }
}
