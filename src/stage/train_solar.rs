//! SOLAR's model: encoder, decoder and linear-Gaussian dynamics, by structured variational inference on whole episodes.

mod params;
mod state;

use params::Params;
use state::Training;

use super::{Stage, StageCx, divergence::TrainingStep, inputs, network_sizes};
use crate::{
    artifact::Trajectories,
    lce::model::background_of,
    num::sampling,
    record::{At, topic},
    solar::{
        MOST_ACTION, MOST_LATENT, SolarModel,
        trainer::{Data, SolarTrainer},
    },
};

inputs! {
    pub(super) struct Inputs {
        /// whole episodes to learn from
        trajectories: Vec<Trajectories>,
        /// the model to go on with; without one, a random model
        warm_start: Option<SolarModel>,
    }
}

pub(super) struct TrainSolar;

impl Stage for TrainSolar {
    const KIND: &'static str = "train_solar";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "SOLAR's representation and linear-Gaussian dynamics, by structured inference";
    type Params = Params;
    type Inputs = Inputs;
    type Output = SolarModel;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<SolarModel> {
        let trajectories = Trajectories::concat(&inputs.trajectories)?;
        let steps = trajectories.steps()?;
        let sizes = params.sizes(network_sizes(cx.task), trajectories.picture, cx.frames_of_observation())?;
        anyhow::ensure!(
            sizes.latent <= MOST_LATENT && sizes.action <= MOST_ACTION,
            "SOLAR takes codes of up to {MOST_LATENT} and actions of up to {MOST_ACTION} components; here are {} and {}",
            sizes.latent,
            sizes.action
        );
        let transitions = params.transitions(steps);
        let mut training = cx.resume_or(|| {
            let background = background_of(&trajectories.observations, &sizes);
            let new = || SolarModel::new(sizes, background, transitions, params.push(), &mut cx.rng("weights"));
            Ok(Training { model: inputs.warm_start.unwrap_or_else(new), epoch: 0, step: 0 })
        })?;
        fits(&training.model, &trajectories, transitions)?;
        let data = data(&training.model, &trajectories, steps);
        let batch = (params.batch as usize).min(data.len());
        let mut trainer = SolarTrainer::new(&training.model, params.settings(steps), steps, batch);
        let probe = cx.map_probe();
        while training.epoch < params.epochs {
            let log_p = one_pass(params, &mut trainer, &mut training, &data, cx)?;
            let at = At::new(cx.round, training.epoch as u32, training.step);
            if training.epoch.is_multiple_of(params.map_every) || training.epoch == params.epochs {
                probe.record(&training.model.networks, cx.record, at);
                pictures(cx, at, &trajectories, &training.model);
            }
            cx.tick(training.epoch, params.epochs, &format!("log p {log_p:.0}"), &training)?;
        }
        Ok(training.model)
    }
}

/// Refuses a model of another task, or of episodes of another length.
fn fits(model: &SolarModel, trajectories: &Trajectories, transitions: usize) -> anyhow::Result<()> {
    let sizes = &model.networks.sizes;
    anyhow::ensure!(
        (sizes.pixels, sizes.action) == (trajectories.pixels(), trajectories.action_dim),
        "the model of input `warm_start` reads other pictures or actions than the trajectories hold"
    );
    anyhow::ensure!(
        model.dynamics.len() == transitions,
        "the model of input `warm_start` has dynamics for {} transitions, not {transitions}",
        model.dynamics.len()
    );
    Ok(())
}

/// Trains on every trajectory once. Gives the mean of ln p(x | z).
fn one_pass(
    params: &Params,
    trainer: &mut SolarTrainer,
    training: &mut Training,
    data: &Data,
    cx: &mut StageCx<'_>,
) -> anyhow::Result<f64> {
    let Training { model, epoch, step } = training;
    let order = sampling::shuffled(&mut cx.rng(("batches", *epoch)), data.len());
    let mut noise = cx.rng(("noise", *epoch));
    let mut log_p = 0.0;
    for batch in order.chunks(trainer.batch()) {
        let beta = params.beta.at(*step);
        let terms = trainer.step(cx.threads.get(), model, data, batch, beta, &mut noise);
        let curves = terms.curves(beta);
        cx.record.scalars(topic::TRAIN_SOLAR, At::new(cx.round, *epoch as u32, *step), &curves);
        let this = TrainingStep { number: *step, learning_rate: "learning_rate" };
        this.must_be_finite(&curves, trainer.is_finite())?;
        log_p += terms.log_p_image * batch.len() as f64 / data.len() as f64;
        *step += 1;
    }
    *epoch += 1;
    Ok(log_p)
}

/// Trajectories in the form that training reads.
fn data(model: &SolarModel, trajectories: &Trajectories, steps: usize) -> Data {
    let numbers = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect();
    Data {
        images: model.networks.pictures(&trajectories.observations),
        actions: numbers(&trajectories.actions),
        costs: numbers(&trajectories.costs),
        steps,
    }
}

/// One observation and its reconstruction from the mean code.
fn pictures(cx: &mut StageCx<'_>, at: At, trajectories: &Trajectories, model: &SolarModel) {
    let pixels = trajectories.pixels();
    let which = (at.epoch as usize * 37) % (trajectories.observations.len() / pixels);
    let x = &trajectories.observations[which * pixels..][..pixels];
    let z = model.networks.encode_means(&model.networks.pictures(x));
    let decoded: Vec<u8> = model.networks.decode(&z).iter().map(|p| (p * 255.0) as u8).collect();
    cx.picture(topic::PICTURE_OBSERVATION, at, x);
    cx.picture(topic::PICTURE_RECONSTRUCTION, at, &decoded);
}
