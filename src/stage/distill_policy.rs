//! Carries a policy from the old latent space into the new one (paper, equation "policy-distillation").

mod state;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::state::Distillation;
use super::{Preset, PresetOf, Refusal, Stage, StageCx, above_zero, inputs, within};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{Agent, agent::Whitening, distill},
    lce::LceModel,
    nn::{adam::Adam, mlp::Pass},
    num::sampling,
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Adam steps.
    steps: u64,
    /// Observations of a step.
    batch: u64,
    /// Adam step size.
    learning_rate: f64,
    /// Share of goals that are observations of the data instead of goal images.
    relabel: f64,
    /// Begin with a random actor and random critics, as the paper's "Initialize a soft actor critic policy" says;
    /// otherwise all of the old agent goes along and its actor is refitted.
    fresh: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self { steps: 150, batch: 256, learning_rate: 5e-4, relabel: 0.5, fresh: false }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let general = match of.preset {
            Preset::Recipe => Self::default(),
            Preset::Paper => Self { relabel: 0.0, fresh: true, ..Self::default() },
        };
        of.lay_task_over(DistillPolicy::KIND, general)
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("batch", self.batch);
        above_zero(&mut refusals, "learning_rate", self.learning_rate);
        within(&mut refusals, "relabel", self.relabel, 0.0, 1.0);
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {
        /// observations on which the two policies must agree
        transitions: Vec<Transitions>,
        /// the space to enter
        model: TrainedModel,
        /// the space to leave
        old_model: TrainedModel,
        /// the agent to carry over
        old_agent: Agent,
    }
}

pub(super) struct DistillPolicy;

/// Codes of all observations and goals under one encoder.
struct Codes {
    n: usize,
    data: Vec<f32>,
    goals: Vec<f32>,
}

impl Codes {
    fn of(model: &LceModel, transitions: &Transitions) -> Self {
        let means = |frames: &[u8]| model.encode_means(&model.pictures(frames));
        Self { n: model.sizes.latent, data: means(&transitions.frames()), goals: means(&transitions.goals) }
    }

    fn goal(&self, (is_goal_image, index): (bool, usize)) -> &[f32] {
        let from = if is_goal_image { &self.goals } else { &self.data };
        &from[index * self.n..][..self.n]
    }
}

impl Stage for DistillPolicy {
    const KIND: &'static str = "distill_policy";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "the old policy's image under a new encoder";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Agent;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Agent> {
        let transitions = Transitions::concat(&inputs.transitions)?;
        let teacher = &inputs.old_agent;
        let old = Codes::of(&inputs.old_model.model, &transitions);
        let new = Codes::of(&inputs.model.model, &transitions);
        let n = teacher.latent;
        let (observations, goals) = (new.data.len() / n, new.goals.len() / n);
        let batch = params.batch as usize;
        let mut state = cx.resume_or(|| {
            let student = student(params, teacher, &new, cx);
            let adam = Adam::new(student.actor.arena.len());
            Ok(Distillation { student, adam, rng: cx.rng("batches"), steps: 0, kl: 0.0 })
        })?;
        let (mut old_inputs, mut new_inputs) = (vec![0.0; 2 * n * batch], vec![0.0; 2 * n * batch]);
        let mut pass = Pass::new(&state.student.nets.actor.mlp, batch, 1);
        let mut gradient = vec![0.0; state.student.actor.arena.len()];
        while state.steps < params.steps {
            let Distillation { student, adam, rng, .. } = &mut state;
            for (old_input, new_input) in old_inputs.chunks_exact_mut(2 * n).zip(new_inputs.chunks_exact_mut(2 * n)) {
                let which = sampling::index(rng, observations);
                let is_goal_image = f64::from(sampling::uniform(rng, 0.0, 1.0)) >= params.relabel;
                let goal = (is_goal_image, sampling::index(rng, if is_goal_image { goals } else { observations }));
                teacher.input(&old.data[which * n..][..n], old.goal(goal), old_input);
                student.input(&new.data[which * n..][..n], new.goal(goal), new_input);
            }
            let targets = teacher.gaussians(&teacher.acting, &old_inputs);
            let rate = params.learning_rate;
            state.kl = distill::step(student, adam, rate, &mut pass, &mut gradient, (&new_inputs, &targets));
            cx.record.scalars(topic::TRAIN_DISTILL, At::new(cx.round, 0, state.steps), &[("kl", state.kl)]);
            state.steps += 1;
            if state.steps % 10 == 1 || state.steps == params.steps {
                cx.tick(state.steps, params.steps, &format!("KL {:.3}", state.kl), &state)?;
            }
        }
        let Distillation { mut student, kl, .. } = state;
        student.acting.clone_from(&student.actor.arena);
        cx.metric("kl", kl);
        Ok(student)
    }
}

/// The agent to refit, reading the new codes.
fn student(params: &Params, teacher: &Agent, new: &Codes, cx: &StageCx<'_>) -> Agent {
    let whitening = teacher.whitening.as_ref().map(|_| Whitening::of(&new.data, teacher.latent));
    if params.fresh {
        Agent::new(teacher.latent, teacher.action, whitening, 0.0, &mut cx.rng("weights"))
    } else {
        Agent { whitening, ..teacher.clone() }
    }
}
