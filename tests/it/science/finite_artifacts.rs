//! Numbers that are not finite are neither published nor read.

use std::marker::PhantomData;

use super::divergence::{CHAIN, error_of};
use crate::support::stages;
use carl_pipe::{
    artifact::{Artifact, Collected, Evaluation, Files, LatentMap, ResultSummary, TrainedModel, Transitions},
    control::{Agent, Ilqr, episodes::UnfinishedEpisode},
    inputs,
    num::Threads,
    record::Recorder,
    stage::{InputFiles, Kind, Params, PresetOf, Stage, StageCx},
};
use safetensors::{Dtype, SafeTensors};
use serde_json::json;

/// A kind whose output holds a number that is not finite.
struct Gives<A>(PhantomData<A>);

trait Broken: Artifact {
    fn broken() -> Self;
}

#[derive(Debug, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
struct Nothing {}

impl Params for Nothing {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self {}
    }
}

inputs! {
    struct NoInputs {}
}

impl<A: Broken> Stage for Gives<A> {
    const KIND: &'static str = "gives";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "a number that is not finite";
    type Params = Nothing;
    type Inputs = NoInputs;
    type Output = A;

    fn run(_: &Nothing, _: NoInputs, _: &mut StageCx<'_>) -> anyhow::Result<A> {
        Ok(A::broken())
    }
}

macro_rules! broken {
    ($($artifact:ty, $of:ident: |$value:ident| $break:expr;)*) => { $( impl Broken for $artifact {
        fn broken() -> Self {
            let mut $value = Self::load(&CHAIN.$of).expect("an artifact");
            $break;
            $value
        }
    } )* };
}
broken! {
    Transitions, bootstrap: |it| it.actions[3] = f32::NAN;
    TrainedModel, model: |it| it.adam.v[7] = f32::INFINITY;
    Agent, agent: |it| it.targets[1][0] = f32::NEG_INFINITY;
    LatentMap, map: |it| it.quality = f64::NAN;
    Evaluation, evaluation: |it| it.episodes[1].path[2][0] = f64::NAN;
    Ilqr, ilqr: |it| it.state_cost = f64::INFINITY;
    ResultSummary, summary: |it| it.percent_goal.models[0] = f64::NAN;
    Collected, collected: |it| {
        let state = vec![1.0, f64::NAN];
        it.unfinished = Some(UnfinishedEpisode { before: state.clone(), state, goal: 0, steps: 1 });
    };
}

/// The error of a kind that fails.
fn error<S: Stage>() -> String {
    let mut record = Recorder::off();
    let task = stages::planar();
    let mut cx = StageCx::new(&mut record, &task, stages::stream(S::KIND), 0, Threads::new(1), &stages::Quiet);
    let made = (Kind::of::<S>().run)(&json!({}), &InputFiles::default(), &mut cx);
    format!("{:#}", made.expect_err(S::KIND))
}

#[test]
fn no_type_of_artifact_is_published_with_a_number_that_is_not_finite() {
    fn refusal<A: Broken>() -> String {
        error::<Gives<A>>()
    }
    assert_eq!(refusal::<Transitions>(), "`transitions.safetensors`: tensor `actions` is NaN at index 3");
    let model = refusal::<TrainedModel>();
    assert!(
        model.starts_with("`optimizer.safetensors`: tensor `v.") && model.ends_with(" is inf at index 7"),
        "{model}"
    );
    assert!(refusal::<Agent>().starts_with("`agent.safetensors`: tensor `target_1/"), "{}", refusal::<Agent>());
    assert_eq!(refusal::<LatentMap>(), "`latent_map.json`: `quality` is not finite, or missing");
    assert_eq!(refusal::<Evaluation>(), "`evaluation.json`: `episodes/1/path/2/0` is not finite, or missing");
    assert_eq!(refusal::<Ilqr>(), "`ilqr.json`: `state_cost` is not finite, or missing");
    assert_eq!(refusal::<ResultSummary>(), "`summary.json`: `percent_goal/models/0` is not finite, or missing");
    assert_eq!(refusal::<Collected>(), "`standing.json`: `before/1` is not finite, or missing");
}

/// A kind whose headline is not finite.
struct Measures;

impl Stage for Measures {
    const KIND: &'static str = "measures";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "nothing that is a number";
    const HEADLINE: Option<&'static str> = Some("score");
    type Params = Nothing;
    type Inputs = NoInputs;
    type Output = Ilqr;

    fn run(_: &Nothing, _: NoInputs, cx: &mut StageCx<'_>) -> anyhow::Result<Ilqr> {
        cx.metric("another", f64::NAN);
        cx.metric("score", f64::INFINITY);
        Ok(Ilqr::default())
    }
}

#[test]
fn a_stage_whose_headline_is_not_finite_fails() {
    assert_eq!(error::<Measures>(), "the metric `score` is not finite");
}

/// The files, with NaN as the first number of their last tensor of numbers.
fn poisoned(files: &Files) -> Files {
    let mut files = files.clone();
    let names: Vec<String> = files.names().filter(|name| name.ends_with(".safetensors")).map(str::to_owned).collect();
    for name in names {
        let mut bytes = files.bytes(&name).expect("bytes").into_owned();
        let (header, metadata) = SafeTensors::read_metadata(&bytes).expect("tensors");
        let numbers = metadata.tensors().into_values().filter(|tensor| tensor.dtype == Dtype::F32);
        let last = numbers.map(|tensor| tensor.data_offsets.0).max().expect("a tensor of numbers");
        bytes[8 + header + last..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        files.insert(name, bytes);
    }
    files
}

#[test]
fn an_input_that_is_not_finite_is_refused_by_its_name_and_maker() {
    let chain = &*CHAIN;
    let [data, model, agent] = [&chain.bootstrap, &chain.model, &chain.agent].map(poisoned);
    let (good, both) = (&chain.bootstrap, [&chain.model, &model]);
    for (kind, inputs, input, maker) in [
        (
            "train_lce",
            vec![("transitions", vec![good, &data])],
            "transitions",
            "`generate_data` or `import_data` or `collect`",
        ),
        ("train_lce", vec![("transitions", vec![good]), ("warm_start", vec![&model])], "warm_start", "`train_lce`"),
        ("train_sac", vec![("transitions", vec![good]), ("model", vec![&model])], "model", "`train_lce`"),
        (
            "train_sac",
            vec![("transitions", vec![good]), ("model", vec![both[0]]), ("start", vec![&agent])],
            "start",
            "`distill_policy` or `train_sac`",
        ),
        (
            "evaluate",
            vec![("model", vec![both[0]]), ("agent", vec![&agent])],
            "agent",
            "`distill_policy` or `train_sac`",
        ),
        ("collect", vec![("model", vec![&model]), ("agent", vec![&chain.agent])], "model", "`train_lce`"),
        ("export_latent_map", vec![("model", vec![&model])], "model", "`train_lce`"),
    ] {
        let error = error_of(kind, json!({}), &inputs).expect(kind);
        assert!(error.starts_with(&format!("cannot read input `{input}`: ")), "{error}");
        assert!(error.contains(" is NaN at index 0") && error.contains(&format!("made by {maker}")), "{error}");
    }
}
