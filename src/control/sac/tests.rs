use rand::SeedableRng as _;

use super::{replay::Tuple, *};
use crate::{
    control::agent::{Agent, Whitening},
    lce::{
        BackwardSizes, Differences, Ensemble, ImageNetworks, LceModel, PassiveDynamics, SharedFrames, Sizes, nets::Nets,
    },
    nn::{binary_images::PooledPatches, mlp::Pass},
    num::{rng::Rng, sampling},
};

/// How far one unit of action moves the code in the known dynamics.
const STRIDE: f32 = 0.4;
const LOG_SIGMA: f32 = -4.0;

/// A model whose dynamics are z' = z + STRIDE u, with a little noise: relu(u) - relu(-u) is u.
fn known_model() -> LceModel {
    known_model_of(ImageNetworks::Dense)
}

/// The same, with codes of one position and its speed on a scale of 2.
fn model_with_speeds() -> LceModel {
    let pixel = PooledPatches { columns: 1, side: 1 };
    let differences = Differences::Scaled { scale: 2.0 };
    known_model_of(ImageNetworks::SharedFrames(SharedFrames {
        read: pixel,
        predicted: pixel,
        coordinates: 1,
        differences,
    }))
}

fn known_model_of(images: ImageNetworks) -> LceModel {
    let sizes = Sizes {
        shades: None,
        jacobian_heads: false,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
        images,
        pixels: 2,
        latent: 2,
        action: 2,
        encoder: [1, 1],
        decoder: [1, 1],
        dynamics: [4, 4],
        backward: BackwardSizes { z: 1, u: 1, x: 1, joint: 1 },
    };
    let nets = Nets::new(&sizes);
    let mut arena = vec![0.0; nets.layout.len];
    let [first, second, last] = nets.dynamics.net().layers;
    let mut set = |layer: crate::nn::mlp::Linear, row: usize, column: usize, value: f32| {
        layer.w_b_mut(&mut arena).0[column * layer.n_out + row] = value;
    };
    for k in 0..2 {
        for (half, sign) in [1.0, -1.0].into_iter().enumerate() {
            let unit = 2 * k + half;
            set(first, unit, 2 + k, sign);
            set(second, unit, unit, 1.0);
            set(last, k, unit, sign * STRIDE);
        }
    }
    last.w_b_mut(&mut arena).1[2..].fill(LOG_SIGMA);
    LceModel { sizes, nets, arena, background: vec![0; 2] }
}

fn settings() -> Sac {
    Sac {
        discount: 0.9,
        rollout: 4,
        bootstrap: false,
        tau: 0.05,
        policy_ema_rate: 0.05,
        actor_learning_rate: 1e-3,
        critic_learning_rate: 2e-3,
        temperature: Temperature::Tuned(Tuning::default()),
        reward: Reward::Distance,
        speed_weight: 1.0,
        antifriction: 0.0,
        relabel: 0.0,
        critic_actions: CriticActions::Uniform,
        buffer: 100_000,
    }
}

/// Codes that cover a square, and one goal in the square.
fn codes() -> Codes {
    let mut rng = Rng::seed_from_u64(1);
    let mut code = || [sampling::uniform(&mut rng, -2.0, 2.0), sampling::uniform(&mut rng, -2.0, 2.0)];
    let data = (0..300)
        .flat_map(|_| {
            let [a, b] = code();
            [a, b, LOG_SIGMA, LOG_SIGMA]
        })
        .collect();
    Codes { data, actions: vec![0.5; 600], goals: vec![1.2, -0.7] }
}

fn agent() -> Agent {
    let whitening = Some(Whitening { mean: vec![0.1, -0.1], inverse: vec![0.9, 1.1] });
    Agent::new(2, 2, whitening, -1.0, &mut Rng::seed_from_u64(2))
}

/// A new learner for these settings.
fn learner(settings: &Sac, seed: u64) -> Learner {
    Learner::new(agent(), settings.buffer, Rng::seed_from_u64(seed))
}

/// A trainer with a batch in its buffers and unchanged networks, after a step of size zero.
fn at_rest<'a>(model: &'a LceModel, codes: &'a Codes, settings: Sac) -> SacTrainer<'a> {
    let learner = learner(&settings, 3);
    let mut trainer = SacTrainer::new(learner, model, codes, Sac { temperature: Temperature::Fixed, ..settings });
    trainer.step(1, 0.0);
    trainer
}

/// Compares a gradient in single precision with differences of the loss along it, along its projections on single
/// layers, and along single parameters.
fn check(
    what: &str,
    layers: &[(String, crate::nn::mlp::Linear)],
    gradient: &[f32],
    mut loss: impl FnMut(&[(usize, f32)]) -> f64,
) {
    let mut along = |what: &str, entries: Vec<usize>, h: f64| {
        let norm = entries.iter().map(|&i| f64::from(gradient[i]).powi(2)).sum::<f64>().sqrt();
        assert!(norm > 1e-6, "{what}: no gradient");
        let moved = |step: f64| -> Vec<(usize, f32)> {
            entries.iter().map(|&i| (i, (step * f64::from(gradient[i]) / norm) as f32)).collect()
        };
        let slope = (loss(&moved(h)) - loss(&moved(-h))) / (2.0 * h);
        assert!((slope - norm).abs() < 0.02 * norm, "{what}: the gradient says {norm}, differences say {slope}");
    };
    along(what, (0..gradient.len()).collect(), 3e-3);
    for (name, layer) in layers {
        along(&format!("{what}: {name}"), (layer.at..layer.at + layer.len()).collect(), 3e-3);
        let biases = layer.at + layer.n_in * layer.n_out..layer.at + layer.len();
        let steepest = biases.max_by(|&i, &j| gradient[i].abs().total_cmp(&gradient[j].abs()));
        along(&format!("{what}: a bias of {name}"), steepest.into_iter().collect(), 1e-2);
    }
}

#[test]
fn the_actors_gradient_equals_finite_differences() {
    let (model, codes) = (known_model(), codes());
    let mut trainer = at_rest(&model, &codes, settings());
    let layers = trainer.learner.agent.nets.actor.layout.layers.clone();
    let start = trainer.learner.agent.actor.arena.clone();
    trainer.update_actor(1, 0.0);
    let gradient = trainer.scratch.actor_gradient.clone();
    assert!(trainer.learner.agent.actor.arena == start, "a step of size zero moves nothing");
    check("actor", &layers, &gradient, |moves| {
        trainer.learner.agent.actor.arena.clone_from(&start);
        for (i, step) in moves {
            trainer.learner.agent.actor.arena[*i] += step;
        }
        trainer.update_actor(1, 0.0).0
    });
}

#[test]
fn the_critics_gradients_equal_finite_differences() {
    let (model, codes) = (known_model(), codes());
    let mut trainer = at_rest(&model, &codes, settings());
    let layers = trainer.learner.agent.nets.critic.layout.layers.clone();
    trainer.update_critics(1, 0.0);
    for which in 0..2 {
        let start = trainer.learner.agent.critics[which].arena.clone();
        let gradient = trainer.scratch.critic_gradients[which].clone();
        check(&format!("critic {which}"), &layers, &gradient, |moves| {
            trainer.learner.agent.critics[which].arena.clone_from(&start);
            for (i, step) in moves {
                trainer.learner.agent.critics[which].arena[*i] += step;
            }
            // The step reports the mean of both critics' losses.
            2.0 * trainer.update_critics(1, 0.0)
        });
        trainer.learner.agent.critics[which].arena.clone_from(&start);
    }
}

#[test]
fn a_regression_of_the_critics_on_fixed_targets_lowers_their_loss() {
    let (model, codes) = (known_model(), codes());
    let mut trainer = at_rest(&model, &codes, settings());
    let losses: Vec<f64> = (0..30).map(|_| trainer.update_critics(1, 1.0)).collect();
    assert!(losses[29] < 0.1 * losses[0], "{losses:?}");
}

/// The smaller target critic at a whitened (z, z_g) and an action.
fn smaller_target_critic(agent: &Agent, mut input: Vec<f32>, action: &[f64]) -> f64 {
    input.extend(action.iter().map(|&u| u as f32));
    let net = &agent.nets.critic.mlp;
    let value = |target: &Vec<f32>| {
        let mut pass = Pass::new(net, 1, 1);
        net.forward(target, &input, &mut pass.view(1));
        f64::from(pass.output()[0])
    };
    agent.targets.iter().map(value).fold(f64::INFINITY, f64::min)
}

/// The target of one sample by the definition, in double precision.
fn plain_target(trainer: &SacTrainer<'_>, sample: usize) -> f64 {
    let (agent, settings) = (&trainer.learner.agent, &trainer.settings);
    let tuple = Tuple::read(&trainer.scratch.tuples.data[sample * 8..][..8], 2, 2);
    let double = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
    let goal = double(tuple.z_goal);
    let reward = |action: &[f64], z: &[f64]| {
        let factors = double(&trainer.distance_factors);
        let squared: f64 = z.iter().zip(&goal).zip(factors).map(|((z, g), factor)| ((z - g) * factor).powi(2)).sum();
        match settings.reward {
            Reward::Distance => -squared.sqrt(),
            Reward::Quadratic => -50.0 * squared - action.iter().map(|u| u * u).sum::<f64>(),
        }
    };
    let whitened = |z: &[f64]| {
        let mut input = vec![0.0; 4];
        agent.input(&z.iter().map(|&z| z as f32).collect::<Vec<f32>>(), tuple.z_goal, &mut input);
        input
    };
    let alpha = f64::from(agent.temperature());
    let mut z = double(tuple.z_next);
    let mut target = reward(&double(tuple.action), &z);
    for step in 0..settings.rollout + usize::from(settings.bootstrap) {
        let discount = settings.discount.powi(step as i32 + 1);
        let noise = &trainer.scratch.rollout_noise[(step * BATCH + sample) * 4..][..4];
        let gaussian = agent.gaussians(&agent.actor.arena, &whitened(&z));
        let mut action = vec![0.0; 2];
        let mut log_pi = 0.0;
        for k in 0..2 {
            let (mu, log_sigma, epsilon) = (f64::from(gaussian[k]), f64::from(gaussian[2 + k]), f64::from(noise[k]));
            action[k] = (mu + log_sigma.exp() * epsilon).tanh();
            let density = -0.5 * epsilon * epsilon - log_sigma - 0.5 * std::f64::consts::TAU.ln();
            log_pi += density - (1.0 - action[k] * action[k]).ln();
        }
        target -= discount * alpha * log_pi;
        if step == settings.rollout {
            return target + discount * smaller_target_critic(agent, whitened(&z), &action);
        }
        let gained = trainer.antifriction.as_ref().map_or(0.0, |it| f64::from(it.factors[sample]) * z[1]);
        for k in 0..2 {
            let gained = if k == 0 { gained / 2.0 } else { gained };
            let moved =
                z[k] + gained + f64::from(STRIDE) * action[k] + f64::from(LOG_SIGMA).exp() * f64::from(noise[2 + k]);
            z[k] = moved.clamp(f64::from(trainer.bounds.low[k]), f64::from(trainer.bounds.high[k]));
        }
        target += discount * reward(&action, &z);
    }
    target
}

#[test]
fn targets_are_those_of_the_algorithm_written_out() {
    let (model, codes) = (known_model(), codes());
    for (bootstrap, reward, rollout) in [
        (false, Reward::Distance, 4),
        (true, Reward::Distance, 3),
        (true, Reward::Quadratic, 0),
        (false, Reward::Quadratic, 2),
    ] {
        let trainer = at_rest(&model, &codes, Sac { bootstrap, reward, rollout, ..settings() });
        for sample in 0..BATCH {
            let (got, want) = (f64::from(trainer.scratch.rollout.target.data[sample]), plain_target(&trainer, sample));
            let near = (got - want).abs() < 1e-4 * want.abs().max(1.0);
            assert!(near, "{bootstrap} {reward:?} {rollout}, sample {sample}: {got} is not {want}");
        }
    }
}

#[test]
fn antifriction_adds_to_speeds_and_half_as_much_to_positions_and_leaves_the_targets_those_of_the_algorithm() {
    let (model, codes) = (model_with_speeds(), codes());
    let trainer = at_rest(&model, &codes, Sac { antifriction: 0.4, speed_weight: 3.0, ..settings() });
    let factors = &trainer.antifriction.as_ref().expect("codes with speeds").factors;
    assert!(factors.len() == BATCH && factors.iter().all(|c| (0.0..0.4).contains(c)));
    assert!(factors.iter().any(|&c| c < 0.1) && factors.iter().any(|&c| c > 0.3));
    for sample in 0..BATCH {
        let (got, want) = (f64::from(trainer.scratch.rollout.target.data[sample]), plain_target(&trainer, sample));
        assert!((got - want).abs() < 1e-4 * want.abs().max(1.0), "sample {sample}: {got} is not {want}");
    }
}

#[test]
fn the_weight_of_speeds_keeps_the_mean_squared_distance_and_codes_without_speeds_have_none() {
    let (model, codes) = (model_with_speeds(), codes());
    let trainer = at_rest(&model, &codes, Sac { speed_weight: 3.0, ..settings() });
    let [position, speed] = trainer.distance_factors[..] else { panic!("two coordinates") };
    assert!((speed / position - 3.0).abs() < 1e-6);
    let mean_squared = |factors: [f32; 2]| {
        let of = |code: &[f32]| {
            let off = |k: usize| (code[k] - codes.goals[k]) * factors[k];
            off(0) * off(0) + off(1) * off(1)
        };
        codes.data.chunks_exact(4).map(of).sum::<f32>()
    };
    assert!((mean_squared([position, speed]) / mean_squared([1.0; 2]) - 1.0).abs() < 1e-4);
    let known = known_model();
    let without = at_rest(&known, &codes, Sac { speed_weight: 3.0, antifriction: 0.4, ..settings() });
    assert!(without.antifriction.is_none() && without.distance_factors == [1.0; 2]);
}

/// Mean distance to the goal after ten mean actions of the acting policy, under the true dynamics.
fn distance_after_ten_actions(agent: &Agent, codes: &Codes) -> f32 {
    let mut z: Vec<f32> = codes.data.chunks_exact(4).flat_map(|code| &code[..2]).copied().collect();
    let goals: Vec<f32> = codes.goals.iter().copied().cycle().take(z.len()).collect();
    for _ in 0..10 {
        let actions = agent.act(&z, &goals, None);
        z.iter_mut().zip(&actions).for_each(|(z, u)| *z += STRIDE * u);
    }
    let squared = z
        .chunks_exact(2)
        .zip(goals.chunks_exact(2))
        .map(|(z, g)| (z[0] - g[0], z[1] - g[1]))
        .map(|(a, b)| a * a + b * b);
    squared.map(f32::sqrt).sum::<f32>() / (z.len() / 2) as f32
}

#[test]
fn updates_under_known_dynamics_learn_to_reach_the_goal() {
    let (model, codes) = (known_model(), codes());
    let before = distance_after_ten_actions(&agent(), &codes);
    let mut trainer = SacTrainer::new(learner(&settings(), 4), &model, &codes, settings());
    let values: Vec<f64> = (0..150).map(|_| trainer.step(1, 1.0).value).collect();
    let after = distance_after_ten_actions(&trainer.learner.agent, &codes);
    assert!(before > 1.2 && after < 0.5 * before, "distance {before} -> {after}");
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    assert!(
        mean(&values[130..]) > mean(&values[..20]) + 0.5,
        "value {} -> {}",
        mean(&values[..20]),
        mean(&values[130..])
    );
}

#[test]
fn the_temperature_moves_entropy_towards_its_target() {
    let (model, codes) = (known_model(), codes());
    let mut trainer = at_rest(&model, &codes, settings());
    let alpha_after = |trainer: &mut SacTrainer<'_>, entropy: f64| {
        let before = trainer.learner.agent.temperature();
        trainer.update_temperature(entropy);
        trainer.learner.agent.temperature() / before
    };
    // The target is minus the number of action components, -2.
    trainer.settings.temperature = Temperature::Tuned(Tuning::default());
    assert!(alpha_after(&mut trainer, -3.0) > 1.0, "too little entropy raises alpha");
    trainer.learner.agent.log_alpha.adam = crate::nn::adam::Adam::new(1);
    assert!(alpha_after(&mut trainer, -1.0) < 1.0, "too much entropy lowers alpha");
    trainer.settings.temperature = Temperature::Fixed;
    assert_eq!(alpha_after(&mut trainer, -3.0), 1.0);
    trainer.settings.temperature = Temperature::Decayed;
    assert!((f64::from(alpha_after(&mut trainer, -3.0)) - 0.99995).abs() < 1e-6);
}

#[test]
fn averaged_networks_move_by_their_rate_and_targets_stay_without_a_bootstrap() {
    let (model, codes) = (known_model(), codes());
    for bootstrap in [false, true] {
        let settings = Sac { bootstrap, policy_ema_rate: 1.0, ..settings() };
        let mut trainer = SacTrainer::new(learner(&settings, 5), &model, &codes, settings);
        let targets = trainer.learner.agent.targets.clone();
        trainer.step(1, 1.0);
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(&trainer.learner.agent.acting, &trainer.learner.agent.actor.arena));
        assert_eq!(trainer.learner.agent.targets == targets, !bootstrap);
    }
}

#[test]
fn every_instruction_set_trains_to_the_same_bits() {
    let (model, codes) = (known_model(), codes());
    crate::num::instruction_sets::on_every_instruction_set(|| {
        let settings = Sac { bootstrap: true, ..settings() };
        let mut trainer = SacTrainer::new(learner(&settings, 9), &model, &codes, settings);
        for _ in 0..3 {
            trainer.step(1, 1.0);
        }
        let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        (bits(&trainer.learner.agent.actor.arena), bits(&trainer.learner.agent.critics[0].arena))
    });
}

/// An ensemble whose members all are the model's F.
fn copies_of_f(model: &LceModel, count: usize) -> Ensemble {
    let f = model.nets.dynamics;
    let parameters = model.arena[f.parameters()].to_vec();
    Ensemble { net: f.alone(), members: vec![parameters; count] }
}

#[test]
fn an_ensemble_of_copies_of_f_trains_the_agent_that_f_trains() {
    let (model, codes) = (known_model(), codes());
    let ensemble = copies_of_f(&model, 5);
    let [mut by_f, mut by_ensemble] =
        [(); 2].map(|()| SacTrainer::new(learner(&settings(), 4), &model, &codes, settings()));
    by_ensemble = by_ensemble.with_ensemble(&ensemble);
    for _ in 0..3 {
        assert_eq!(by_f.step(1, 1.0), by_ensemble.step(2, 1.0));
    }
    assert_eq!(by_f.learner.agent, by_ensemble.learner.agent);
}

#[test]
fn each_member_of_an_ensemble_moves_the_targets_of_its_share_only() {
    let (model, codes) = (known_model(), codes());
    let same = copies_of_f(&model, 4);
    let mut other = same.clone();
    other.members[2].fill(0.0);
    let targets = |ensemble: &Ensemble| {
        let mut trainer = at_rest(&model, &codes, settings()).with_ensemble(ensemble);
        trainer.compute_targets(1);
        trainer.scratch.rollout.target.data.clone()
    };
    let (before, after) = (targets(&same), targets(&other));
    let quarter = BATCH / 4;
    for (sample, (before, after)) in before.iter().zip(&after).enumerate() {
        assert_eq!(before != after, sample / quarter == 2, "sample {sample}");
    }
}
