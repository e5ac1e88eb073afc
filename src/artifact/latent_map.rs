//! The latent map of a model as data: the codes of known states, with the colours and axes to draw them by.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    tensors::{TensorFile, Tensors, read_json},
};

/// Codes of states on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct LatentMap {
    /// Dimension of the latent space.
    pub latent: usize,
    /// (row, column) of every state on the grid.
    pub grid: Vec<[u32; 2]>,
    /// The position of every state in the unit square.
    pub places: Vec<[f32; 2]>,
    /// The colour of every state, as red, green and blue: states near each other have similar colours.
    pub colours: Vec<[u8; 3]>,
    /// Mean E(x) of every state, one after the other.
    pub codes: Vec<f32>,
    /// Means of E(x_g).
    pub goals: Vec<f32>,
    /// One axis for each latent dimension.
    pub axes: Vec<LatentAxis>,
    /// R² of the best affine map from codes to coordinates of the states: 1 for a perfect map. An angle that turns
    /// around counts as a point on the circle.
    pub quality: f64,
}

/// The range of the codes of states and goals in one latent dimension.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LatentAxis {
    /// `z1`, `z2` and so on.
    pub name: String,
    /// The least code.
    pub low: f32,
    /// The greatest code.
    pub high: f32,
}

#[derive(Serialize, Deserialize)]
struct About {
    latent: usize,
    quality: f64,
    axes: Vec<LatentAxis>,
}

impl LatentMap {
    /// A map with the colours of its places and with axes that hold all codes and goals.
    pub fn new(grid: Vec<[u32; 2]>, places: Vec<[f32; 2]>, codes: Codes, quality: f64) -> Self {
        let Codes { latent, states, goals } = codes;
        let colours = places.iter().map(|&[row, column]| [(row * 255.0) as u8, (column * 255.0) as u8, 160]).collect();
        let axes = (0..latent).map(|dimension| {
            let all = || states.chunks(latent).chain(goals.chunks(latent)).map(|code| code[dimension]);
            let name = format!("z{}", dimension + 1);
            LatentAxis { name, low: all().fold(f32::MAX, f32::min), high: all().fold(f32::MIN, f32::max) }
        });
        let axes = axes.collect();
        Self { latent, grid, places, colours, codes: states, goals, axes, quality }
    }
}

/// Codes of states and of goals, each one after the other.
#[derive(Debug, Clone)]
pub struct Codes {
    /// Dimension of the latent space.
    pub latent: usize,
    /// Mean E(x) of every state.
    pub states: Vec<f32>,
    /// Mean E(x_g) of every goal.
    pub goals: Vec<f32>,
}

impl Artifact for LatentMap {
    const TYPE: &'static str = "latent_map";

    fn save(self) -> anyhow::Result<Files> {
        let n = self.latent;
        let mut tensors = Tensors::default();
        tensors
            .u32("grid", &[self.grid.len(), 2], self.grid.as_flattened())
            .f32("places", &[self.places.len(), 2], self.places.as_flattened())
            .u8("colours", &[self.colours.len(), 3], self.colours.as_flattened())
            .f32("codes", &[self.codes.len() / n, n], &self.codes)
            .f32("goals", &[self.goals.len() / n, n], &self.goals);
        let about = About { latent: n, quality: self.quality, axes: self.axes.clone() };
        Ok(Files::from([("latent_map.safetensors", tensors.content()?), ("latent_map.json", json(&about)?.into())]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { latent, quality, axes } = read_json(files, "latent_map.json")?;
        let tensors = TensorFile::open(files, "latent_map.safetensors")?;
        let shape = tensors.shape("codes")?;
        let states = shape.first().copied().unwrap_or_default();
        ensure!(latent > 0 && shape == [states, latent], "codes of shape {shape:?}");
        ensure!(axes.len() == latent, "{} axes for {latent} latent dimensions", axes.len());
        for (name, width) in [("grid", 2), ("places", 2), ("colours", 3)] {
            let shape = tensors.shape(name)?;
            ensure!(shape == [states, width], "`{name}` has shape {shape:?}, not [{states}, {width}]");
        }
        let goals = tensors.shape("goals")?;
        ensure!(goals.len() == 2 && goals[1] == latent, "goals of shape {goals:?}");
        Ok(Self {
            latent,
            grid: tensors.u32("grid")?.as_chunks::<2>().0.to_vec(),
            places: tensors.f32("places")?.as_chunks::<2>().0.to_vec(),
            colours: tensors.u8("colours")?.as_chunks::<3>().0.to_vec(),
            codes: tensors.f32("codes")?,
            goals: tensors.f32("goals")?,
            axes,
            quality,
        })
    }
}
