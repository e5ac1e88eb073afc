//! A trained LCE model: its layers, the optimiser that goes on with them, and the widths that place them.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    tensors::{TensorFile, Tensors, file},
};
use crate::{
    lce::{LceModel, Sizes, model::Nets},
    nn::{adam::Adam, mlp::Layout},
};

/// A model and its optimiser.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedModel {
    /// The networks.
    pub model: LceModel,
    /// Adam's moments for all of them.
    pub adam: Adam<f32>,
}

#[derive(Serialize, Deserialize)]
struct About {
    sizes: Sizes,
    adam_steps: u64,
}

/// Writes the layers of an arena as `NAME.weight` \[in, out\] and `NAME.bias` \[out\]: y = x @ weight + bias.
pub(super) fn put_layers(tensors: &mut Tensors, prefix: &str, layout: &Layout, arena: &[f32]) {
    for (name, layer) in &layout.layers {
        tensors.f32(format!("{prefix}{name}.weight"), &[layer.n_in, layer.n_out], layer.w(arena));
        tensors.f32(format!("{prefix}{name}.bias"), &[layer.n_out], layer.b(arena));
    }
}

/// Reads what [`put_layers`] wrote.
pub(super) fn take_layers(tensors: &TensorFile<'_>, prefix: &str, layout: &Layout) -> anyhow::Result<Vec<f32>> {
    let mut arena = vec![0.0; layout.len];
    for (name, layer) in &layout.layers {
        let (w, b) = layer.w_b_mut(&mut arena);
        for (part, values) in [("weight", w), ("bias", b)] {
            let name = format!("{prefix}{name}.{part}");
            let read = tensors.f32(&name)?;
            ensure!(read.len() == values.len(), "tensor `{name}` has {} values, not {}", read.len(), values.len());
            values.copy_from_slice(&read);
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
        let about = About { sizes: sizes.clone(), adam_steps: self.adam.steps };
        Ok(Files::from([
            ("model.safetensors".to_owned(), model.bytes()?),
            ("optimizer.safetensors".to_owned(), optimizer.bytes()?),
            ("model.json".to_owned(), json(&about)?),
        ]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { sizes, adam_steps } = serde_json::from_slice(file(files, "model.json")?)?;
        let nets = Nets::new(&sizes);
        let tensors = TensorFile::open(file(files, "model.safetensors")?)?;
        let optimizer = TensorFile::open(file(files, "optimizer.safetensors")?)?;
        let adam = Adam {
            m: take_layers(&optimizer, "m.", &nets.layout)?,
            v: take_layers(&optimizer, "v.", &nets.layout)?,
            steps: adam_steps,
        };
        let arena = take_layers(&tensors, "", &nets.layout)?;
        Ok(Self { model: LceModel { sizes, nets, arena, background: tensors.u8("background")? }, adam })
    }
}
