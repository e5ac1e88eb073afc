//! Writes the latent map of all valid states, as numbers and as a picture.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PresetOf, Stage, StageCx, inputs, probe};
use crate::{
    artifact::{LatentMap, TrainedModel},
    record::At,
};

#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {}

impl super::Params for Params {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

inputs! {
    pub(super) struct Inputs {
        /// whose encoder is shown
        model: TrainedModel,
    }
}

pub(super) struct ExportLatentMap;

impl Stage for ExportLatentMap {
    const KIND: &'static str = "export_latent_map";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "where the encoder puts all valid states, as numbers and as a picture";
    type Params = Params;
    type Inputs = Inputs;
    type Output = LatentMap;

    fn run(_: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<LatentMap> {
        let map = cx.map_probe().map(&inputs.model.model);
        probe::write(&map, cx.record, At::new(cx.round, 0, 0));
        cx.figure("map_quality", map.quality);
        Ok(map)
    }
}
