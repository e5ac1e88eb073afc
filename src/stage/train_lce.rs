//! Learns the representation: encoder, dynamics, decoder and backward dynamics (paper, lines 3-7 of the CARL algorithm).

mod attempt;
mod checks;
mod curves;
mod new_model;
mod objective;
mod params;
mod presets;
mod state;
mod steps;
mod terms;

use self::{
    attempt::Setup,
    params::{Params, Slopes},
    state::{Attempt, Training},
};
use super::{Diverged, Stage, StageCx, divergence::TrainingStep, fits, inputs, network_sizes};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::Agent,
    lce::{
        LceModel,
        map_checks::{self, MapChecks},
    },
    record::Level,
};

inputs! {
    pub(super) struct Inputs {
        /// what to learn from
        transitions: Vec<Transitions>,
        /// the model to go on with; without one, training starts afresh, with a warm-up
        warm_start: Option<TrainedModel>,
        /// the policy that L_reg keeps
        policy: Option<Agent>,
        /// the agent, of `warm_start`'s latent space, whose TD errors weigh L_p and L_c in value-guided CARL
        value: Option<Agent>,
    }
}

pub(super) struct TrainLce;

impl Stage for TrainLce {
    const KIND: &'static str = "train_lce";
    /// 3: parameters under their choice; same output as 2.
    const VERSION: u32 = 3;
    const ABOUT: &'static str = "encoder, dynamics, decoder and backward dynamics by the loss of CARL, value-guided or not, PCC, PC3, E2C or RCE";
    type Params = Params;
    type Inputs = Inputs;
    type Output = TrainedModel;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        let transitions = &Transitions::concat(&inputs.transitions)?;
        inputs.fit(transitions)?;
        let setup = Setup {
            params,
            transitions,
            regularizer: terms::l_reg(params, &inputs, transitions)?,
            guidance: terms::value_guided(params, &inputs, transitions, cx)?,
            has_warm_start: inputs.warm_start.is_some(),
        };
        let mut training = cx.resume_or(|| match &inputs.warm_start {
            Some(model) => Ok(Training::new(warm_start(params, model.clone())?)),
            None => Ok(Training::new(new_model(0, params, transitions, cx)?)),
        })?;
        let (kept, checks) = best_of_attempts(&setup, &mut training, cx)?;
        if kept.number < training.attempt {
            warn(cx, &training, &format!("kept attempt {} of {}", kept.number + 1, training.attempt + 1));
        }
        // The data of the first round lie far from the goals, so no goal is suspect yet.
        let suspect_goals = if setup.has_warm_start { checks.suspect_goals() } else { Vec::new() };
        let why_suspect = suspect_goals.iter().map(|&goal| checks.why_suspect(goal));
        for sentence in checks.fault(params.least_alignment).into_iter().chain(why_suspect) {
            warn(cx, &training, &sentence);
        }
        report(cx, training.attempt, &checks);
        Ok(TrainedModel { suspect_goals, ..kept.trained })
    }
}

impl Inputs {
    /// Refuses inputs that do not fit each other.
    fn fit(&self, transitions: &Transitions) -> anyhow::Result<()> {
        anyhow::ensure!(!transitions.is_empty(), "there are no transitions to learn from");
        let Some(start) = &self.warm_start else { return Ok(()) };
        fits::model("warm_start", &start.model, transitions)?;
        self.policy.iter().try_for_each(|agent| fits::agent("policy", agent, &start.model))?;
        self.value.iter().try_for_each(|agent| fits::agent("value", agent, &start.model))
    }
}

/// Trains until the best map passes its checks, or no retraining is left. Gives the best map and its checks. An attempt
/// that diverges gives no map; if all do, so does the stage.
fn best_of_attempts(
    setup: &Setup<'_>,
    training: &mut Training,
    cx: &mut StageCx<'_>,
) -> anyhow::Result<(Attempt, MapChecks)> {
    let (params, transitions) = (setup.params, setup.transitions);
    let least_alignment = params.least_alignment;
    loop {
        let trained = setup.train(training, cx);
        let earlier = training.best.take();
        let is_last = training.attempt >= params.restarts;
        let (best, fault) = match trained {
            Ok(trained) => {
                let attempt = Attempt { number: training.attempt, trained };
                let (best, checks) = better_map(earlier, attempt, setup);
                match checks.fault(least_alignment) {
                    Some(fault) if !is_last => (Some(best).filter(|_| !checks.is_diverged()), fault),
                    _ if checks.is_diverged() => {
                        let step = TrainingStep { number: training.all_steps, learning_rate: "learning_rate" };
                        return Err(step.diverged("codes are not numbers").into());
                    }
                    _ => return Ok((best, checks)),
                }
            }
            Err(error) => match (error.downcast::<Diverged>()?, earlier) {
                (diverged, None) if is_last => return Err(diverged.into()),
                (diverged, Some(best)) if is_last => {
                    warn(cx, training, &diverged.to_string());
                    let checks = check_map(&best.trained.model, setup);
                    return Ok((best, checks));
                }
                (diverged, earlier) => (earlier, diverged.to_string()),
            },
        };
        let next = training.attempt + 1;
        warn(cx, training, &format!("{fault}; retraining from new weights ({next} of {})", params.restarts));
        training.begin_again(best, new_model(next, params, transitions, cx)?);
    }
}

/// The model of the round before, with the passive dynamics of these parameters.
fn warm_start(params: &Params, mut model: TrainedModel) -> anyhow::Result<TrainedModel> {
    anyhow::ensure!(
        model.model.sizes.jacobian_heads == (params.slopes == Slopes::Amortized),
        "`slopes` differs from what the model of `warm_start` was trained with"
    );
    anyhow::ensure!(
        model.model.sizes.locally_linear == params.objective.is_locally_linear(),
        "the model of `warm_start` has another kind of dynamics than `objective` needs: those of E2C and RCE are locally linear"
    );
    model.set_passive_dynamics(params.passive_dynamics);
    Ok(model)
}

/// A model with random weights, other ones in every attempt.
fn new_model(
    attempt: u64,
    params: &Params,
    transitions: &Transitions,
    cx: &StageCx<'_>,
) -> anyhow::Result<TrainedModel> {
    let (sizes, frames) = (network_sizes(cx.task), cx.frames_of_observation());
    let mut model = new_model::random_model(params, transitions, sizes, frames, &mut cx.rng(("weights", attempt)))?;
    model.set_passive_dynamics(params.passive_dynamics);
    Ok(model)
}

/// The attempt with the better map, and the checks of its map. The earlier attempt wins a tie.
fn better_map(best: Option<Attempt>, new: Attempt, setup: &Setup<'_>) -> (Attempt, MapChecks) {
    let new_checks = check_map(&new.trained.model, setup);
    let Some(best) = best else { return (new, new_checks) };
    let checks = check_map(&best.trained.model, setup);
    let least_alignment = setup.params.least_alignment;
    if new_checks.score(least_alignment) > checks.score(least_alignment) { (new, new_checks) } else { (best, checks) }
}

/// Observations that the map checks read: the first ones, which come from random states.
const CHECKED: usize = 1024;

/// Goals have no rank where the objective does not decode.
fn check_map(model: &LceModel, setup: &Setup<'_>) -> MapChecks {
    let (objective, transitions) = (&setup.params.objective, setup.transitions);
    let checked = transitions.len().min(CHECKED) * transitions.pixels();
    let observations = model.pictures(&transitions.observations[..checked]);
    let goals = if objective.decodes() { &transitions.goals[..] } else { &[] };
    map_checks::check(model, &observations, &model.pictures(goals))
}

fn report(cx: &mut StageCx<'_>, restarts: u64, checks: &MapChecks) {
    cx.metric("restarts", restarts as f64);
    cx.metric("code_spread", checks.spread);
    cx.metric("action_alignment", checks.alignment);
    if !checks.goal_ranks.is_empty() {
        cx.metric("goal_rank", checks.goal_rank());
    }
}

fn warn(cx: &mut StageCx<'_>, training: &Training, sentence: &str) {
    cx.log(training.now(cx.round), Level::Warning, sentence);
}
