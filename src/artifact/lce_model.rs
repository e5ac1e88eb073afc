//! A trained LCE model: its layers, the optimiser that goes on with them, and the widths that place them.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    tensors::{TensorFile, Tensors, file},
};
use crate::{
    lce::{Drift, LceModel, Sizes, model::Nets},
    nn::{adam::Adam, binary_images::PooledPatches, mlp::Layout},
};

/// A model and its optimiser.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedModel {
    /// The networks.
    pub model: LceModel,
    /// Adam's moments for all of them.
    pub adam: Adam<f32>,
    /// Goal images whose codes may be those of other places: whoever collects looks around there.
    pub doubted_goals: Vec<usize>,
}

impl TrainedModel {
    /// Goes on under an anchor with another drift. One that the model has already is kept, with its moments.
    pub fn set_drift(&mut self, drift: Drift) {
        self.model.set_drift(drift);
        let count = self.model.arena.len();
        self.adam.m.resize(count, 0.0);
        self.adam.v.resize(count, 0.0);
    }
}

#[derive(Serialize, Deserialize)]
struct About {
    sizes: Sizes,
    adam_steps: u64,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    doubted_goals: Vec<usize>,
}

/// Writes the layers of an arena as `NAME.weight` \[in, out\] and `NAME.bias` \[out\]: y = x @ weight + bias.
pub(super) fn put_layers(tensors: &mut Tensors, prefix: &str, layout: &Layout, arena: &[f32]) {
    for (name, layer) in &layout.layers {
        tensors.f32(format!("{prefix}{name}.weight"), &[layer.n_in, layer.n_out], layer.w(arena));
        tensors.f32(format!("{prefix}{name}.bias"), &[layer.n_out], layer.b(arena));
    }
}

/// Refuses widths that no network of ours has, before anything is computed from them.
pub(super) fn check_widths<'a>(widths: impl IntoIterator<Item = &'a usize>) -> anyhow::Result<()> {
    for &width in widths {
        ensure!((1..=1 << 24).contains(&width), "a width of {width}");
    }
    Ok(())
}

/// Reads what [`put_layers`] wrote.
pub(super) fn take_layers(tensors: &TensorFile<'_>, prefix: &str, layout: &Layout) -> anyhow::Result<Vec<f32>> {
    // Grows with what is read: widths from a damaged file must not decide over memory.
    let mut arena = Vec::new();
    for (name, layer) in &layout.layers {
        for (part, shape) in [("weight", &[layer.n_in, layer.n_out][..]), ("bias", &[layer.n_out])] {
            let name = format!("{prefix}{name}.{part}");
            let found = tensors.shape(&name)?;
            ensure!(found == shape, "tensor `{name}` has shape {found:?}, not {shape:?}");
            arena.extend(tensors.f32(&name)?);
        }
    }
    Ok(arena)
}

impl Artifact for TrainedModel {
    const TYPE: &'static str = "lce_model";

    fn save(&self) -> anyhow::Result<Files> {
        let LceModel { sizes, nets, arena, background } = &self.model;
        let mut model = Tensors::default();
        put_layers(&mut model, "", &nets.layout, arena);
        model.u8("background", &[sizes.pixels], background);
        let mut optimizer = Tensors::default();
        put_layers(&mut optimizer, "m.", &nets.layout, &self.adam.m);
        put_layers(&mut optimizer, "v.", &nets.layout, &self.adam.v);
        let about =
            About { sizes: sizes.clone(), adam_steps: self.adam.steps, doubted_goals: self.doubted_goals.clone() };
        Ok(Files::from([
            ("model.safetensors".to_owned(), model.bytes()?),
            ("optimizer.safetensors".to_owned(), optimizer.bytes()?),
            ("model.json".to_owned(), json(&about)?),
        ]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { sizes, adam_steps, doubted_goals } = serde_json::from_slice(file(files, "model.json")?)?;
        let Sizes {
            pixels,
            latent,
            action,
            convolution,
            squares,
            encoder,
            decoder,
            dynamics,
            backward,
            slopes: _,
            drift: _,
        } = &sizes;
        check_widths(
            [pixels, latent, action].into_iter().chain(encoder).chain(decoder).chain(dynamics).chain(backward),
        )?;
        if let Some([frames, rows, columns]) = *convolution {
            check_widths(&[frames, rows, columns])?;
            let smallest = (rows / 8) * (columns / 8);
            ensure!(
                rows % 8 == 0
                    && columns % 8 == 0
                    && frames.saturating_mul(rows).saturating_mul(columns) == *pixels
                    && encoder[0].is_multiple_of(smallest)
                    && decoder[1].is_multiple_of(smallest),
                "convolutions of {frames} frames of {rows} x {columns} do not go with the other widths"
            );
        }
        if let Some(PooledPatches { columns, side }) = *squares {
            check_widths(&[columns])?;
            ensure!(
                (1..=15).contains(&side)
                    && columns % side == 0
                    && pixels % (columns * side) == 0
                    && convolution.is_none(),
                "squares of {side} pixels in {columns} columns do not go with pictures of {pixels} pixels"
            );
        }
        let nets = Nets::new(&sizes);
        let tensors = TensorFile::open(file(files, "model.safetensors")?)?;
        let optimizer = TensorFile::open(file(files, "optimizer.safetensors")?)?;
        let adam = Adam {
            m: take_layers(&optimizer, "m.", &nets.layout)?,
            v: take_layers(&optimizer, "v.", &nets.layout)?,
            steps: adam_steps,
        };
        let arena = take_layers(&tensors, "", &nets.layout)?;
        let background = tensors.u8("background")?;
        ensure!(background.len() == sizes.pixels, "a background of {} pixels, not {}", background.len(), sizes.pixels);
        Ok(Self { model: LceModel { sizes, nets, arena, background }, adam, doubted_goals })
    }
}
