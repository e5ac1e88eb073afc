//! Writes the latent map of all valid states, as numbers and as a picture.

use super::{NoParams, Stage, StageCx, inputs, probe};
use crate::{
    artifact::{LatentMap, TrainedModel},
    record::At,
};

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
    type Params = NoParams;
    type Inputs = Inputs;
    type Output = LatentMap;

    fn run(_: &NoParams, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<LatentMap> {
        let map = cx.map_probe().map(&inputs.model.model);
        probe::write(&map, cx.record, At::new(cx.round, 0, 0));
        cx.metric("map_quality", map.quality);
        Ok(map)
    }
}
