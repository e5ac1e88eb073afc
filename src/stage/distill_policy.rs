//! Carries a policy from the old latent space into the new one (paper, equation "policy-distillation").

mod state;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::state::Distillation;
use super::{
    MOST_STEPS, Preset, PresetOf, Refusal, Stage, StageCx, StepScale, above_zero, count, divergence::TrainingStep,
    fits, inputs, within,
};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{Agent, agent::Whitening, distill},
    lce::LceModel,
    nn::{adam::Adam, mlp::Pass},
    num::{rng::Rng, sampling},
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Adam steps.
    steps: u64,
    /// Observations in one step.
    batch: u64,
    /// Adam step size.
    learning_rate: f64,
    /// Share of the goals that are observations of the data instead of goal images.
    relabel: f64,
    /// Whether to begin with a random actor and random critics (paper, "Initialize a soft actor critic policy"). Otherwise
    /// the student begins as a copy of the old agent.
    fresh: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self { steps: 150, batch: 256, learning_rate: 5e-4, relabel: 0.5, fresh: false }
    }
}

impl super::Params for Params {
    const STEP_SCALES: &'static [StepScale] = &[StepScale::Grows("learning_rate")];

    fn preset(of: &PresetOf<'_>) -> Self {
        let general = match of.preset {
            Preset::Recipe => Self::default(),
            Preset::Paper => Self { relabel: 0.0, fresh: true, ..Self::default() },
        };
        of.lay_task_over(DistillPolicy::KIND, general)
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "steps", self.steps, 0..=MOST_STEPS);
        count(&mut refusals, "batch", self.batch, 1..=100_000);
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

/// Codes of all observations and goal images under one encoder.
struct Codes {
    latent: usize,
    data: Vec<f32>,
    goals: Vec<f32>,
}

/// A goal of a training sample, by its index.
#[derive(Clone, Copy)]
enum Goal {
    Image(usize),
    Observation(usize),
}

impl Codes {
    fn of(port: &str, model: &LceModel, transitions: &Transitions) -> anyhow::Result<Self> {
        fits::model(port, model, transitions)?;
        let means = |frames: &[u8]| fits::finite_codes(port, model.encode_means(&model.pictures(frames)));
        let (data, goals) = (means(&transitions.frames())?, means(&transitions.goals)?);
        Ok(Self { latent: model.sizes.latent, data, goals })
    }

    fn observation(&self, index: usize) -> &[f32] {
        &self.data[index * self.latent..][..self.latent]
    }

    fn goal(&self, goal: Goal) -> &[f32] {
        match goal {
            Goal::Image(index) => &self.goals[index * self.latent..][..self.latent],
            Goal::Observation(index) => self.observation(index),
        }
    }
}

/// What a distillation learns from: the same observations in the old latent space and in the new one.
struct Paired<'a> {
    teacher: &'a Agent,
    old: Codes,
    new: Codes,
    relabel: f64,
}

/// Inputs of teacher and student at the same samples, one column each.
struct Batch {
    teacher: Vec<f32>,
    student: Vec<f32>,
}

impl Paired<'_> {
    /// Draws observations and goals, and writes them as the two actors read them.
    fn draw(&self, student: &Agent, rng: &mut Rng, batch: &mut Batch) {
        let width = 2 * self.teacher.latent;
        let (observations, goals) = (self.new.data.len() / self.new.latent, self.new.goals.len() / self.new.latent);
        let columns = batch.teacher.chunks_exact_mut(width).zip(batch.student.chunks_exact_mut(width));
        for (teacher_input, student_input) in columns {
            let which = sampling::index(rng, observations);
            let is_image = f64::from(sampling::uniform(rng, 0.0, 1.0)) >= self.relabel;
            let goal = match is_image {
                true => Goal::Image(sampling::index(rng, goals)),
                false => Goal::Observation(sampling::index(rng, observations)),
            };
            self.teacher.input(self.old.observation(which), self.old.goal(goal), teacher_input);
            student.input(self.new.observation(which), self.new.goal(goal), student_input);
        }
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
        let codes = |port, trained: &TrainedModel| Codes::of(port, &trained.model, &transitions);
        let (old, new) = (codes("old_model", &inputs.old_model)?, codes("model", &inputs.model)?);
        fits::agent("old_agent", &inputs.old_agent, &inputs.old_model.model)?;
        fits::agent("old_agent", &inputs.old_agent, &inputs.model.model)?;
        let paired = Paired { teacher: &inputs.old_agent, old, new, relabel: params.relabel };
        let mut state = cx.resume_or(|| {
            let student = student(params, paired.teacher, &paired.new, cx);
            let adam = Adam::new(student.actor.arena.len());
            Ok(Distillation { student, adam, rng: cx.rng("batches"), steps: 0, kl: 0.0 })
        })?;
        let samples = params.batch as usize;
        let inputs = vec![0.0; 2 * paired.teacher.latent * samples];
        let mut batch = Batch { teacher: inputs.clone(), student: inputs };
        let mut pass = Pass::new(&state.student.nets.actor.mlp, samples, 1);
        let mut gradient = vec![0.0; state.student.actor.arena.len()];
        while state.steps < params.steps {
            let Distillation { student, adam, rng, .. } = &mut state;
            paired.draw(student, rng, &mut batch);
            let targets = paired.teacher.gaussians(&paired.teacher.acting, &batch.teacher);
            let pair = (&batch.student[..], &targets[..]);
            let (kl, is_finite) = distill::step(student, adam, params.learning_rate, &mut pass, &mut gradient, pair);
            state.kl = kl;
            cx.record.scalars(topic::TRAIN_DISTILL, At::new(cx.round, 0, state.steps), &[("kl", kl)]);
            let step = TrainingStep { number: state.steps, learning_rate: "learning_rate" };
            step.must_be_finite(&[("kl", kl)], is_finite)?;
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

/// The agent before distillation. It reads codes of the new latent space.
fn student(params: &Params, teacher: &Agent, new: &Codes, cx: &StageCx<'_>) -> Agent {
    let whitening = teacher.whitening.as_ref().map(|_| Whitening::of(&new.data, teacher.latent));
    if params.fresh {
        Agent::new(teacher.latent, teacher.action, whitening, 0.0, &mut cx.rng("weights"))
    } else {
        Agent { whitening, ..teacher.clone() }
    }
}
