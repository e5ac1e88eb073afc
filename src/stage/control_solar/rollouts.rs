//! Rollouts of an iteration, and what they showed.

use super::Params;
use crate::{
    control::{
        Acting, SolarPolicy,
        episodes::{self, Episode, Streams, Unstick},
    },
    env::{Simulator, Spec, System},
    num::rng::Rng,
    record::{At, MapFrame, Recorder, topic},
    solar::{SolarModel, controller::Plan, local_dynamics::Rollouts},
    stage::{StageCx, state_cost::Observer},
};

/// Goals that share a policy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Group {
    pub(super) goals: Vec<usize>,
}

/// The rollouts of a group.
pub(super) struct GroupRollouts {
    pub(super) rollouts: Rollouts,
    /// The observed cost of every step; none where no costs are observed.
    pub(super) costs: Vec<f64>,
    /// Share of the steps at the goal.
    pub(super) percent_goal: f64,
    /// The true position of every step, for maps alone; none where states have no position.
    places: Vec<[f32; 2]>,
}

/// Runs policies in a simulator.
pub(super) struct Runner<'a> {
    params: &'a Params,
    model: &'a SolarModel,
    observer: Option<&'a Observer>,
    simulator: Box<dyn Simulator>,
    system: Option<Box<dyn System>>,
    spec: Spec,
    pub(super) goal_images: Vec<Vec<u8>>,
}

impl<'a> Runner<'a> {
    pub(super) fn new(
        params: &'a Params,
        model: &'a SolarModel,
        observer: Option<&'a Observer>,
        cx: &StageCx<'_>,
    ) -> anyhow::Result<Self> {
        let (simulator, spec) = (cx.task.open()?, cx.task.spec());
        let goal_images = (0..spec.goals).map(|goal| simulator.goal_image(goal)).collect();
        Ok(Self { params, model, observer, simulator, system: cx.task.system(), spec, goal_images })
    }

    /// The rollouts of an iteration, with noise, in turn for every group.
    pub(super) fn roll_out(
        &mut self,
        groups: &[Group],
        plans: &[Plan],
        iteration: u64,
        cx: &mut StageCx<'_>,
    ) -> anyhow::Result<Vec<GroupRollouts>> {
        let mut rng = cx.rng(("rollouts", iteration));
        let rollouts = self.params.rollouts as usize;
        let mut all = Vec::new();
        for (number, group) in groups.iter().enumerate() {
            let count = rollouts / groups.len() + usize::from(number < rollouts % groups.len());
            let plan = &plans[number..=number];
            let mut made = self.episodes(group, plan, Acting::Sample, count, &mut rng, cx)?;
            made.percent_goal /= count as f64;
            all.push(made);
        }
        let at = At::new(cx.round, 0, iteration);
        cx.picture(topic::PICTURE_COLLECTED, at, &self.simulator.observe());
        Ok(all)
    }

    /// The percent of time at the goal by mean actions. Nothing learns from these episodes.
    pub(super) fn measure(
        &mut self,
        groups: &[Group],
        plans: &[Plan],
        iteration: u64,
        cx: &StageCx<'_>,
    ) -> anyhow::Result<f64> {
        let mut rng = cx.rng(("measured", iteration));
        let (mut sum, mut episodes) = (0.0, 0);
        for (number, group) in groups.iter().enumerate() {
            let count = self.params.measured as usize * group.goals.len();
            sum += self.episodes(group, &plans[number..=number], Acting::Mean, count, &mut rng, cx)?.percent_goal;
            episodes += count;
        }
        Ok(sum / episodes as f64)
    }

    /// Runs episodes to the goals of a group in turn. `percent_goal` is their sum.
    fn episodes(
        &mut self,
        group: &Group,
        plan: &[Plan],
        acting: Acting,
        count: usize,
        rng: &mut Rng,
        cx: &StageCx<'_>,
    ) -> anyhow::Result<GroupRollouts> {
        let (steps, sizes) = (self.spec.horizon, &self.model.networks.sizes);
        let rollouts = Rollouts { steps, d: sizes.latent, m: sizes.action, ..Rollouts::default() };
        let mut made = GroupRollouts { rollouts, costs: Vec::new(), percent_goal: 0.0, places: Vec::new() };
        let mut policy = SolarPolicy::new(&self.model.networks, plan, acting);
        for episode in 0..count {
            let goal = group.goals[episode % group.goals.len()];
            self.simulator.reset(self.params.start, goal, rng)?;
            let mut states: Vec<Vec<f64>> =
                self.simulator.snapshot().into_iter().map(|now| now.state.clone()).collect();
            let mut hits = 0;
            let run = Episode { goal, steps, unstick: Unstick::Off, random_from: None };
            let streams = Streams { acting: rng, plans: cx.rng("plans") };
            let path = episodes::run(&mut *self.simulator, &mut policy, run, streams, |simulator| {
                hits += usize::from(simulator.is_at_goal(self.spec.goal_radius));
                states.extend(simulator.snapshot().map(|now| now.state.clone()));
            })?;
            made.percent_goal += 100.0 * hits as f64 / steps as f64;
            let (precision, linear) = policy.seen();
            made.rollouts.precision.extend_from_slice(precision);
            made.rollouts.linear.extend_from_slice(linear);
            for (step, state) in path.iter().zip(&states) {
                made.rollouts.actions.extend(step.action.iter().map(|&a| f64::from(a)));
                made.costs.extend(self.observer.map(|it| f64::from(it.cost(state, goal, &step.action))));
                made.places.extend(self.system.as_ref().and_then(|system| system.place(state)));
            }
        }
        Ok(made)
    }

    /// Records the smoothed means of a group's rollouts over their true positions. Nothing learns from the positions.
    pub(super) fn record_map(
        &self,
        means: &[f64],
        rollouts: &GroupRollouts,
        groups: &[Group],
        record: &mut Recorder,
        at: At,
    ) {
        let d = rollouts.rollouts.d;
        if rollouts.places.is_empty() {
            return;
        }
        let pad = |code: &[f64]| [0, 1, 2].map(|i| code.get(i).map_or(0.0, |&z| z as f32));
        let latents: Vec<[f32; 3]> = means.chunks_exact(d).map(pad).collect();
        let goal_images = groups.iter().flat_map(|group| &group.goals).flat_map(|&goal| &self.goal_images[goal]);
        let goal_images: Vec<u8> = goal_images.copied().collect();
        let networks = &self.model.networks;
        let goals = networks.encode_means(&networks.pictures(&goal_images));
        let goals: Vec<f64> = goals.iter().map(|&z| f64::from(z)).collect();
        let goals: Vec<[f32; 3]> = goals.chunks_exact(d).map(pad).collect();
        let places: Vec<Vec<f32>> = rollouts.places.iter().map(|place| place.to_vec()).collect();
        let codes: Vec<f32> = means.iter().map(|&z| z as f32).collect();
        let quality = crate::stage::probe::affine_fit(&codes, d, &places);
        let frame = MapFrame { positions: &rollouts.places, latents: &latents, goals: &goals, quality };
        record.latent_map(topic::LATENT_SMOOTHED, at, &frame);
    }
}
