//! Writes the latent map of a model: the codes of all valid states, with their colours and axes.

use super::{NoParams, Stage, StageCx, inputs, probe};
use crate::{
    artifact::{EncoderOf, LatentMap},
    record::At,
};

inputs! {
    pub(super) struct Inputs {
        /// the model whose encoder is shown
        model: EncoderOf,
    }
}

pub(super) struct ExportLatentMap;

impl Stage for ExportLatentMap {
    const KIND: &'static str = "export_latent_map";
    /// 2: the artifact holds colours and axes in place of an SVG picture; `carl-pipe plot` draws the picture. 3: numbers of
    /// a code that all states share no longer make the quality 0.
    const VERSION: u32 = 3;
    const ABOUT: &'static str = "the codes of all valid states, for `carl-pipe plot` to draw";
    type Params = NoParams;
    type Inputs = Inputs;
    type Output = LatentMap;

    fn run(_: &NoParams, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<LatentMap> {
        let (probe, task) = (cx.map_probe(), cx.task.name());
        anyhow::ensure!(probe.has_map(), "`{task}` declares no states for a latent map");
        let map = probe.map(&inputs.model.0);
        probe::write(&map, cx.record, At::new(cx.round, 0, 0));
        cx.metric("map_quality", map.quality);
        Ok(map)
    }
}
