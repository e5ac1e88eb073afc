//! A trained LCE model: its layers, the state of its optimiser, and its widths.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use super::{
    Artifact, Files, json,
    sizes::SizesFile,
    tensors::{TensorFile, Tensors, read_json},
};
use crate::{
    lce::{LceModel, PassiveDynamics, Sizes, nets::Nets},
    nn::{adam::Adam, mlp::Layout},
    solar::is_without_dynamics,
};

/// A model and its optimiser.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedModel {
    /// The networks.
    pub model: LceModel,
    /// Adam's moments for all of them.
    pub adam: Adam<f32>,
    /// Suspect goals, by number: their codes may belong to other places, so collection explores around them.
    pub suspect_goals: Vec<usize>,
}

impl TrainedModel {
    /// Changes the passive dynamics of the anchor. Where the model has these already, their parameters and moments stay.
    pub fn set_passive_dynamics(&mut self, passive_dynamics: PassiveDynamics) {
        self.model.set_passive_dynamics(passive_dynamics);
        let count = self.model.arena.len();
        self.adam.m.resize(count, 0.0);
        self.adam.v.resize(count, 0.0);
    }
}

#[derive(Serialize, Deserialize)]
struct About {
    sizes: SizesFile,
    adam_steps: u64,
    #[serde(default, rename = "doubted_goals", skip_serializing_if = "Vec::is_empty")]
    suspect_goals: Vec<usize>,
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

/// The networks of any model, for a stage that takes its encoder alone. A model of SOLAR has no F, so stages that plan or
/// train in F take a [`TrainedModel`] instead.
#[derive(Debug, Clone, PartialEq)]
pub struct EncoderOf(pub LceModel);

impl Artifact for EncoderOf {
    const TYPE: &'static str = "encoder";

    fn save(self) -> anyhow::Result<Files> {
        let adam = Adam::new(self.0.arena.len());
        TrainedModel { model: self.0, adam, suspect_goals: Vec::new() }.save()
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        take_networks(files).map(|trained| Self(trained.model))
    }
}

impl Artifact for TrainedModel {
    const TYPE: &'static str = "lce_model";
    const READABLE_AS: &'static [&'static str] = &[EncoderOf::TYPE];

    fn save(self) -> anyhow::Result<Files> {
        let LceModel { sizes, nets, arena, background } = &self.model;
        let mut model = Tensors::default();
        put_layers(&mut model, "", &nets.layout, arena);
        model.u8("background", &[sizes.pixels], &background[..]);
        let mut optimizer = Tensors::default();
        put_layers(&mut optimizer, "m.", &nets.layout, &self.adam.m);
        put_layers(&mut optimizer, "v.", &nets.layout, &self.adam.v);
        let about =
            About { sizes: sizes.into(), adam_steps: self.adam.steps, suspect_goals: self.suspect_goals.clone() };
        Ok(Files::from([
            ("model.safetensors", model.content()?),
            ("optimizer.safetensors", optimizer.content()?),
            ("model.json", json(&about)?.into()),
        ]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let trained = take_networks(files)?;
        ensure!(!is_without_dynamics(&trained.model.sizes), "a model of SOLAR, which has no F");
        Ok(trained)
    }
}

/// The networks of an LCE model or of a SOLAR model.
pub(super) fn take_networks(files: &Files) -> anyhow::Result<TrainedModel> {
    let About { sizes, adam_steps, suspect_goals } = read_json(files, "model.json")?;
    let sizes = Sizes::try_from(sizes)?;
    let nets = Nets::new(&sizes);
    let tensors = TensorFile::open(files, "model.safetensors")?;
    let optimizer = TensorFile::open(files, "optimizer.safetensors")?;
    let adam = Adam {
        m: take_layers(&optimizer, "m.", &nets.layout)?,
        v: take_layers(&optimizer, "v.", &nets.layout)?,
        steps: adam_steps,
    };
    let arena = take_layers(&tensors, "", &nets.layout)?;
    let background = tensors.u8("background")?;
    ensure!(background.len() == sizes.pixels, "a background of {} pixels, not {}", background.len(), sizes.pixels);
    Ok(TrainedModel { model: LceModel { sizes, nets, arena, background }, adam, suspect_goals })
}
