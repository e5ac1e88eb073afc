//! Model-based soft actor-critic in the latent space (paper, "learning a latent space policy").

mod members;
mod state;

use anyhow::{Context as _, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use members::Members;

use super::{
    MOST_COPIES, MOST_STEPS, Memory, Preset, PresetOf, Refusal, Stage, StageCx, StepScale, Symmetries, above_zero,
    count, divergence::TrainingStep, fits, inputs, within,
};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{
        Agent,
        agent::Whitening,
        sac::{self, Codes, CriticActions, Learner, Reward, Sac, SacTerms, SacTrainer, Temperature, Tuning},
    },
    lce::{LceModel, Sizes},
    num::math,
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Updates of critics, actor and temperature.
    steps: u64,
    /// Discount factor.
    discount: f64,
    /// k, the steps of the latent rollout behind a critic's target.
    rollout: u64,
    /// Whether a target adds the target critics' value at the end of the latent rollout.
    bootstrap: bool,
    /// Share of the new critics in the target critics at every update.
    tau: f64,
    /// Share of the new actor in the averaged policy at every update. With 1 the newest actor acts.
    policy_ema_rate: f64,
    /// Adam step size of the actor.
    actor_learning_rate: f64,
    /// Adam step size of the critics.
    critic_learning_rate: f64,
    /// Share of the step sizes of actor and critics at the last update. They fall linearly to it.
    learning_rate_end_factor: f64,
    /// How the temperature moves.
    temperature: Temperature,
    /// Temperature of a new agent.
    initial_temperature: f64,
    /// The reward of a step.
    reward: Reward,
    /// Networks F that latent rollouts follow in place of the model's F.
    ensemble: Members,
    /// Factor on the speeds of a code in the reward's distance. The distance is rescaled to the same mean square. Needs
    /// codes that hold scaled differences of frames.
    speed_weight: f64,
    /// The largest antifriction c of latent rollouts: every step adds c v to each speed v of a code. Each rollout draws
    /// its own c for each speed. Antifriction balances the friction that F learns from noisy differences of frames.
    antifriction: f64,
    /// Share of the goals that are observations of the data instead of goal images.
    relabel: f64,
    /// The actions that the critics are trained on.
    critic_actions: CriticActions,
    /// Whether a new agent's networks read whitened codes.
    whiten: bool,
    /// Tuples that the latent replay buffer holds.
    buffer: u64,
    /// Symmetries of the task, each with the share of the transitions that it changes. Goal images stay as they are.
    symmetries: Symmetries,
    /// Number of randomly changed copies of the transitions; latent rollouts begin in all copies. Has no effect without
    /// `symmetries`.
    symmetric_copies: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            steps: 250,
            discount: 0.99,
            rollout: 5,
            bootstrap: false,
            tau: 0.005,
            policy_ema_rate: 0.005,
            actor_learning_rate: 5e-4,
            critic_learning_rate: 1e-3,
            learning_rate_end_factor: 1.0,
            temperature: Temperature::Tuned(Tuning::default()),
            initial_temperature: 1.0,
            reward: Reward::Distance,
            ensemble: Members::default(),
            speed_weight: 1.0,
            antifriction: 0.0,
            relabel: 0.5,
            critic_actions: CriticActions::Uniform,
            whiten: true,
            buffer: 1_000_000,
            symmetries: Symmetries::default(),
            symmetric_copies: 4,
        }
    }
}

impl super::Params for Params {
    const STEP_SCALES: &'static [StepScale] = &[
        StepScale::Grows("critic_learning_rate"),
        StepScale::Grows("actor_learning_rate"),
        StepScale::Grows("temperature.tuned.learning_rate"),
        StepScale::Grows("ensemble.learning_rate"),
        StepScale::Grows("initial_temperature"),
    ];

    fn preset(of: &PresetOf<'_>) -> Self {
        let general = match of.preset {
            Preset::Recipe => Self::default(),
            Preset::Paper => Self {
                policy_ema_rate: 1.0,
                temperature: Temperature::Decayed,
                relabel: 0.0,
                critic_actions: CriticActions::Data,
                whiten: false,
                ..Self::default()
            },
        };
        of.lay_task_over(TrainSac::KIND, general)
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "steps", self.steps, 1..=MOST_STEPS);
        count(&mut refusals, "rollout", self.rollout, 0..=1000);
        count(&mut refusals, "buffer", self.buffer, 1..=MOST_STEPS);
        self.ensemble.check(&mut refusals);
        count(&mut refusals, "symmetric_copies", self.symmetric_copies, 1..=MOST_COPIES);
        for (path, share) in [
            ("discount", self.discount),
            ("tau", self.tau),
            ("policy_ema_rate", self.policy_ema_rate),
            ("learning_rate_end_factor", self.learning_rate_end_factor),
            ("relabel", self.relabel),
            ("antifriction", self.antifriction),
        ] {
            within(&mut refusals, path, share, 0.0, 1.0);
        }
        for (path, value) in [
            ("actor_learning_rate", self.actor_learning_rate),
            ("critic_learning_rate", self.critic_learning_rate),
            ("initial_temperature", self.initial_temperature),
            ("speed_weight", self.speed_weight),
        ] {
            above_zero(&mut refusals, path, value);
        }
        if let Temperature::Tuned(Tuning { learning_rate }) = self.temperature {
            above_zero(&mut refusals, "temperature.tuned.learning_rate", learning_rate);
        }
        refusals
    }

    fn symmetries(&self) -> Option<&Symmetries> {
        Some(&self.symmetries)
    }

    fn memory(&self, sizes: &Sizes) -> Option<Memory> {
        let tuple = 4 * (3 * sizes.latent + sizes.action) as u64;
        Some(Memory { path: "buffer", bytes: self.tuples().saturating_mul(tuple) })
    }
}

inputs! {
    pub(super) struct Inputs {
        /// where latent rollouts begin
        transitions: Vec<Transitions>,
        /// encoder and dynamics
        model: TrainedModel,
        /// the agent to go on with; without one, a random agent
        start: Option<Agent>,
    }
}

pub(super) struct TrainSac;

impl Stage for TrainSac {
    const KIND: &'static str = "train_sac";
    /// 2: parameters under their choice; same output.
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "an agent by model-based soft actor-critic in the latent space";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Agent;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Agent> {
        let transitions = Transitions::concat(&inputs.transitions)?;
        let model = &inputs.model.model;
        fits::model("model", model, &transitions)?;
        inputs.start.iter().try_for_each(|agent| fits::agent("start", agent, model))?;
        let codes = codes(params, model, &transitions, cx)?;
        let mut learner = cx.resume_or(|| {
            let agent = inputs.start.unwrap_or_else(|| random_agent(params, model, &codes, cx));
            Ok(Learner::new(agent, params.buffer as usize, cx.rng("updates")))
        })?;
        let reserved = learner.buffer.reserve(params.tuples() as usize);
        reserved.with_context(|| format!("no memory for {} tuples: lower `buffer`", params.tuples()))?;
        let copies = cx.symmetric_copies(&transitions, &params.symmetries, params.symmetric_copies);
        let ensemble = params.ensemble.fit(model, copies, &mut cx.rng("ensemble"))?;
        let mut trainer = SacTrainer::new(learner, model, &codes, params.sac());
        if let Some(ensemble) = &ensemble {
            trainer = trainer.with_ensemble(ensemble);
        }
        while trainer.learner.steps < params.steps {
            let step = trainer.learner.steps;
            let done = step as f64 / params.steps as f64;
            let terms = trainer.step(cx.threads.get(), 1.0 - (1.0 - params.learning_rate_end_factor) * done);
            let curves = curves(&terms);
            cx.record.scalars(topic::TRAIN_SAC, At::new(cx.round, 0, step), &curves);
            let learning_rate = "critic_learning_rate";
            TrainingStep { number: step, learning_rate }.must_be_finite(&curves, trainer.is_finite())?;
            if step.is_multiple_of(25) || step + 1 == params.steps {
                let value = terms.value;
                let note = format!("value {value:.1}");
                cx.tick(step + 1, params.steps, &note, &trainer.learner)?;
            }
        }
        Ok(trainer.learner.agent)
    }
}

/// What SAC is trained on. Rollouts begin at the codes of all copies of the transitions.
fn codes(params: &Params, model: &LceModel, transitions: &Transitions, cx: &StageCx<'_>) -> anyhow::Result<Codes> {
    let needs_speeds = params.antifriction > 0.0 || params.speed_weight != 1.0;
    ensure!(
        !needs_speeds || model.sizes.speeds().is_some(),
        "`antifriction` and `speed_weight` need a model whose codes hold speeds: write `networks = {{ shared_frames = \
         {{ differences = {{ scaled = {{ scale = 2.0 }} }} }} }}` in the `train_lce` stage of the model, or leave both out"
    );
    let (mut observations, mut actions) = (model.pictures(&[]), Vec::new());
    let copies = cx.symmetric_copies(transitions, &params.symmetries, params.symmetric_copies);
    copies.for_each(|pictures, action| {
        observations.extend(&pictures[..transitions.pixels()]);
        actions.extend_from_slice(action);
    });
    Ok(Codes {
        data: fits::finite_codes("model", model.encode(&observations))?,
        actions,
        goals: fits::finite_codes("model", model.encode_means(&model.pictures(&transitions.goals)))?,
    })
}

/// An agent with random weights.
fn random_agent(params: &Params, model: &LceModel, codes: &Codes, cx: &StageCx<'_>) -> Agent {
    let n = model.sizes.latent;
    let means: Vec<f32> = codes.data.chunks_exact(2 * n).flat_map(|code| &code[..n]).copied().collect();
    let whitening = params.whiten.then(|| Whitening::of(&means, n));
    let log_alpha = math::ln(params.initial_temperature as f32);
    Agent::new(n, model.sizes.action, whitening, log_alpha, &mut cx.rng("weights"))
}

fn curves(terms: &SacTerms) -> [(&'static str, f64); 5] {
    [
        ("critic_loss", terms.critic),
        ("actor_loss", terms.actor),
        ("value", terms.value),
        ("entropy", terms.entropy),
        ("temperature", terms.temperature),
    ]
}

impl Params {
    /// Tuples that the buffer holds at the end.
    fn tuples(&self) -> u64 {
        self.buffer.min(self.steps.saturating_mul(sac::BATCH as u64))
    }

    fn sac(&self) -> Sac {
        Sac {
            discount: self.discount,
            rollout: self.rollout as usize,
            bootstrap: self.bootstrap,
            tau: self.tau,
            policy_ema_rate: self.policy_ema_rate,
            actor_learning_rate: self.actor_learning_rate,
            critic_learning_rate: self.critic_learning_rate,
            temperature: self.temperature,
            reward: self.reward,
            speed_weight: self.speed_weight,
            antifriction: self.antifriction,
            relabel: self.relabel,
            critic_actions: self.critic_actions,
            buffer: self.buffer as usize,
        }
    }
}
