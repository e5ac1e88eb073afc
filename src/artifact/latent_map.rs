//! Where an encoder puts known states: numbers, and a picture.

use std::fmt::Write as _;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    tensors::{TensorFile, Tensors, file},
};

/// Codes of states on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct LatentMap {
    /// Dimension of the latent space.
    pub latent: usize,
    /// (row, column) of every state on the grid.
    pub grid: Vec<[u32; 2]>,
    /// Where every state is, in the unit square.
    pub places: Vec<[f32; 2]>,
    /// Mean E(x) of every state, one after the other.
    pub codes: Vec<f32>,
    /// Means of E(x_g).
    pub goals: Vec<f32>,
    /// Share of variance of the places that an affine read-out of the codes explains (R²): 1 for a perfect map. Of an
    /// angle that turns around, the point on the circle counts.
    pub quality: f64,
}

#[derive(Serialize, Deserialize)]
struct About {
    latent: usize,
    quality: f64,
}

impl LatentMap {
    /// Width and height of the picture.
    pub const SVG_SIDE: f32 = 480.0;

    /// The first two latent coordinates as an SVG picture: neighbours on the grid are joined, colours are places.
    pub fn svg(&self) -> String {
        let (side, drawing) = (Self::SVG_SIDE, self.svg_drawing());
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {side} {side}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{drawing}</svg>\n"
        )
    }

    /// What the picture shows, for a square of [`LatentMap::SVG_SIDE`].
    pub fn svg_drawing(&self) -> String {
        const MARGIN: f32 = 24.0;
        let xy = |code: &[f32]| [code[0], code.get(1).copied().unwrap_or(0.0)];
        let all: Vec<[f32; 2]> = self.codes.chunks(self.latent).chain(self.goals.chunks(self.latent)).map(xy).collect();
        let bound = |i: usize, pick: fn(f32, f32) -> f32, start| all.iter().map(|p| p[i]).fold(start, pick);
        let low = [0, 1].map(|i| bound(i, f32::min, f32::MAX));
        let high = [0, 1].map(|i| bound(i, f32::max, f32::MIN));
        let scale = [0, 1].map(|i| (Self::SVG_SIDE - 2.0 * MARGIN) / (high[i] - low[i]).max(1e-6));
        let place = |p: [f32; 2]| [0, 1].map(|i: usize| MARGIN + (p[i] - low[i]) * scale[i]);
        let points: Vec<[f32; 2]> = all[..self.grid.len()].iter().map(|&p| place(p)).collect();
        let mut svg = "<g stroke=\"#bbb\" stroke-width=\".6\">\n".to_owned();
        let mut index = std::collections::BTreeMap::new();
        for (i, cell) in self.grid.iter().enumerate() {
            index.insert(*cell, i);
        }
        for (i, [row, column]) in self.grid.iter().enumerate() {
            for neighbour in [[row + 1, *column], [*row, column + 1]] {
                if let Some(&j) = index.get(&neighbour) {
                    let ([a, b], [c, d]) = (points[i], points[j]);
                    let _ = writeln!(svg, "<path d=\"M{a:.1} {b:.1}L{c:.1} {d:.1}\"/>");
                }
            }
        }
        svg.push_str("</g>\n");
        for ([x, y], [row, column]) in points.iter().zip(&self.places) {
            let (red, green) = ((row * 255.0) as u8, (column * 255.0) as u8);
            let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"rgb({red},{green},160)\"/>");
        }
        for [x, y] in all[self.grid.len()..].iter().map(|&p| place(p)) {
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\" fill=\"none\" stroke=\"#000\" stroke-width=\"2.5\"/>"
            );
        }
        svg
    }
}

impl Artifact for LatentMap {
    const TYPE: &'static str = "latent_map";

    fn save(&self) -> anyhow::Result<Files> {
        let n = self.latent;
        let mut tensors = Tensors::default();
        tensors
            .u32("grid", &[self.grid.len(), 2], self.grid.as_flattened())
            .f32("places", &[self.places.len(), 2], self.places.as_flattened())
            .f32("codes", &[self.codes.len() / n, n], &self.codes)
            .f32("goals", &[self.goals.len() / n, n], &self.goals);
        Ok(Files::from([
            ("latent_map.safetensors".to_owned(), tensors.bytes()?),
            ("latent_map.json".to_owned(), json(&About { latent: n, quality: self.quality })?),
            ("latent_map.svg".to_owned(), self.svg().into_bytes()),
        ]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { latent, quality } = serde_json::from_slice(file(files, "latent_map.json")?)?;
        let tensors = TensorFile::open(file(files, "latent_map.safetensors")?)?;
        let shape = tensors.shape("codes")?;
        let states = shape.first().copied().unwrap_or_default();
        ensure!(latent > 0 && shape == [states, latent], "codes of shape {shape:?}");
        for name in ["grid", "places"] {
            ensure!(tensors.shape(name)? == [states, 2], "`{name}` is not of {states} states");
        }
        let goals = tensors.shape("goals")?;
        ensure!(goals.len() == 2 && goals[1] == latent, "goals of shape {goals:?}");
        Ok(Self {
            latent,
            grid: tensors.u32("grid")?.as_chunks::<2>().0.to_vec(),
            places: tensors.f32("places")?.as_chunks::<2>().0.to_vec(),
            codes: tensors.f32("codes")?,
            goals: tensors.f32("goals")?,
            quality,
        })
    }
}
