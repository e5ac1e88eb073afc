//! What is timed: training steps of the four tasks' models, an update of SAC, one decision, SOLAR's training steps and its
//! smoother.

use carl_pipe::{
    control::{
        Agent,
        agent::Whitening,
        sac::{Codes, CriticActions, Learner, Reward, Sac, SacTrainer, Temperature, Tuning},
    },
    env::Task,
    lce::{
        BackwardSizes, ImageNetworks, LceModel, PreparedEncoder, Sizes,
        model::background,
        objective::Weights,
        trainer::{BATCH, Data, Objective, Trainer},
    },
    nn::adam::{Adam, AdamSettings},
    num::{rng::Rng, sampling},
    solar::{
        self, SolarModel,
        chain::{Evidence, chain},
        mniw::{Expected, Mniw},
        trainer::SolarTrainer,
    },
    stage::network_sizes,
};
use rand::SeedableRng as _;
use serde_json::json;

/// All of them.
pub(crate) const NAMES: [&str; 9] =
    ["planar", "swing_up", "cart_pole", "three_pole", "sac", "act", "solar_planar", "solar_swing_up", "smoother"];

/// Transitions in a set: more than fit the caches, as in training.
const TRANSITIONS: usize = 1024;

/// Something to be done over and over.
pub(crate) struct Work {
    step: Box<dyn FnMut() + Send>,
    gflop: f64,
}

impl Work {
    pub(crate) fn new(name: &str, threads: usize) -> Self {
        match name {
            "sac" => sac(threads),
            "act" => act(),
            "solar_planar" => solar("planar", threads),
            "solar_swing_up" => solar("swing_up", threads),
            "smoother" => smoother(),
            _ => represent(name, threads),
        }
    }

    pub(crate) fn step(&mut self) {
        (self.step)();
    }

    /// Work of a step in units of 1e9 operations, a multiply-add counting as two.
    pub(crate) fn gflop(&self) -> f64 {
        self.gflop
    }
}

/// The middle value.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

fn sizes(name: &str) -> Sizes {
    let task = serde_json::from_value(json!({ "env": name }));
    let task: Task = task.unwrap_or_else(|_| panic!("no work `{name}`; there are {}", NAMES.join(", ")));
    network_sizes(&task)
}

/// Transitions of the task itself: x and x' in turn, and actions.
fn transitions(name: &str, rng: &mut Rng) -> (Vec<u8>, Vec<f32>) {
    let task: Task = serde_json::from_value(json!({ "env": name })).expect("a task");
    let env = task.system().expect("equations");
    let (mut frames, mut actions) = (Vec::new(), Vec::new());
    for _ in 0..TRANSITIONS {
        let before = env.sample_state(rng).expect("a state");
        let now = env.step(&before, &env.sample_action(rng), rng);
        let action = env.sample_action(rng);
        let next = env.step(&now, &action, rng);
        frames.extend(env.observe(&before, &now));
        frames.extend(env.observe(&now, &next));
        actions.extend(action.iter().zip(env.action_limit()).map(|(u, limit)| (u / limit) as f32));
    }
    (frames, actions)
}

fn model_and_data(name: &str) -> (LceModel, Data) {
    let (sizes, mut rng) = (sizes(name), Rng::seed_from_u64(1));
    let (frames, actions) = transitions(name, &mut rng);
    let (background, action_dim) = (background(&frames, sizes.pixels), sizes.action);
    let model = LceModel::new(sizes, background, &mut rng);
    let data = Data { images: model.pictures(&frames), actions, action_dim, copies: 1 };
    (model, data)
}

/// One step of CARL's loss, all terms, with Adam.
fn represent(name: &str, threads: usize) -> Work {
    let (model, data) = model_and_data(name);
    let gflop = step_flop(&model.sizes) / 1e9;
    let settings = AdamSettings { learning_rate: 5e-4, weight_decay: 1e-3 };
    let adam = Adam::new(model.arena.len());
    let mut trainer = Trainer::new(model, adam, settings);
    let objective = Objective {
        weights: Weights {
            reconstruction: 1.0,
            consistency: 8.0,
            curvature: 1.0,
            encode_decode: 0.01,
            prior: 0.0,
            deterministic: 0.3,
            regularizer: 0.0,
            anchor: 3.0,
        },
        curvature_sigma: 0.1,
        anchor_scale: 1.0,
        guidance: None,
        regularizer: None,
    };
    let mut rng = Rng::seed_from_u64(2);
    let mut which = [0_u32; BATCH];
    let step = move || {
        which.fill_with(|| sampling::index(&mut rng, TRANSITIONS) as u32);
        std::hint::black_box(trainer.step(threads, &data, &which, &objective, &mut rng));
    };
    Work { step: Box::new(step), gflop }
}

/// Multiply-adds of dense layers, from the width of the input to that of the output.
fn dense(widths: &[usize]) -> f64 {
    widths.windows(2).map(|pair| (pair[0] * pair[1]) as f64).sum()
}

/// Operations of a step: forward, gradients of weights, and gradients of inputs where there are parameters before them.
fn step_flop(sizes: &Sizes) -> f64 {
    let codes = 2 * sizes.latent;
    let conv =
        |side: usize, channels_in: usize, channels_out: usize| (25 * side * side * channels_in * channels_out) as f64;
    let (encoder, first, decoder) = if let ImageNetworks::Convolutional { frames, rows: side, .. } = sizes.images {
        let first = conv(side, frames, 32);
        let others = conv(side / 2, 32, 32) + conv(side / 4, 32, 32) + conv(side / 8, 32, 10);
        let up = conv(side / 8, 10, 32) + conv(side / 4, 32, 32) + conv(side / 2, 32, 32) + conv(side, 32, frames);
        let [flat, hidden] = sizes.encoder;
        (
            first + others + dense(&[flat, hidden, codes]),
            first,
            up + dense(&[sizes.latent, sizes.decoder[0], sizes.decoder[1]]),
        )
    } else {
        let [e0, e1] = sizes.encoder;
        let [d0, d1] = sizes.decoder;
        (
            dense(&[sizes.pixels, e0, e1, codes]),
            dense(&[sizes.pixels, e0]),
            dense(&[sizes.latent, d0, d1, sizes.pixels]),
        )
    };
    let BackwardSizes { z: n_z, u: n_u, x: n_x, joint } = sizes.backward;
    let see = dense(&[sizes.pixels, n_x]);
    let backward =
        see + dense(&[n_z + n_u + n_x, joint, codes]) + dense(&[sizes.latent, n_z]) + dense(&[sizes.action, n_u]);
    let [f0, f1] = sizes.dynamics;
    let dynamics = dense(&[sizes.latent + sizes.action, f0, f1, codes]);
    let each = 2.0 * (3.0 * encoder - first) + 3.0 * 3.0 * decoder + 3.0 * backward - see + 5.0 * 3.0 * dynamics;
    2.0 * BATCH as f64 * each
}

/// One update of SAC, k = 5.
fn sac(threads: usize) -> Work {
    let (model, data) = model_and_data("planar");
    let (n, a) = (model.sizes.latent, model.sizes.action);
    let codes = Codes {
        data: model.encode(&data.images),
        actions: data.actions.repeat(2),
        goals: model.encode_means(&data.images)[..3 * n].to_vec(),
    };
    let (model, codes) = (Box::leak(Box::new(model)), Box::leak(Box::new(codes)));
    let mut rng = Rng::seed_from_u64(3);
    let means: Vec<f32> = codes.data.chunks_exact(2 * n).flat_map(|code| &code[..n]).copied().collect();
    let agent = Agent::new(n, a, Some(Whitening::of(&means, n)), 0.1, &mut rng);
    // The preset `recipe`.
    let settings = Sac {
        discount: 0.99,
        rollout: 5,
        bootstrap: false,
        tau: 0.005,
        policy_ema_rate: 0.005,
        actor_learning_rate: 5e-4,
        critic_learning_rate: 1e-3,
        temperature: Temperature::Tuned(Tuning::default()),
        reward: Reward::Distance,
        speed_weight: 1.0,
        antifriction: 0.0,
        relabel: 0.5,
        critic_actions: CriticActions::Uniform,
        buffer: 1_000_000,
    };
    let rollout = settings.rollout as f64;
    let actor = dense(&[2 * n, 256, 256, 2 * a]);
    let critic = dense(&[2 * n + a, 256, 256, 1]);
    let [f0, f1] = model.sizes.dynamics;
    let dynamics = dense(&[n + a, f0, f1, 2 * n]);
    let regression = 2.0 * 3.0 * critic;
    let improvement = 3.0 * actor + 2.0 * 2.0 * critic;
    let targets = rollout * (actor + dynamics);
    let mut trainer = SacTrainer::new(Learner::new(agent, settings.buffer, rng), model, codes, settings);
    let step = move || {
        std::hint::black_box(trainer.step(threads, 1.0));
    };
    Work { step: Box::new(step), gflop: 2.0 * BATCH as f64 * (targets + regression + improvement) / 1e9 }
}

/// Encoder and policy on one observation of planar.
fn act() -> Work {
    let (model, data) = model_and_data("planar");
    let (n, a) = (model.sizes.latent, model.sizes.action);
    let mut rng = Rng::seed_from_u64(3);
    let agent = Agent::new(n, a, None, 0.1, &mut rng);
    let goal = model.encode_means(&data.images)[..n].to_vec();
    let frames = transitions("planar", &mut rng).0[..model.sizes.pixels].to_vec();
    let gflop = 2.0 * (dense(&[1600, 300, 300, 2 * n]) + dense(&[2 * n, 256, 256, 2 * a])) / 1e9;
    let mut encoder = PreparedEncoder::new(Box::leak(Box::new(model)), 1);
    let step = move || {
        let z = encoder.mean(&frames);
        std::hint::black_box(agent.act(&z, &goal, None));
    };
    Work { step: Box::new(step), gflop }
}

/// One step of SOLAR's ELBO on two episodes, with Adam. The episodes are pictures of random states.
fn solar(name: &str, threads: usize) -> Work {
    let task: Task = serde_json::from_value(json!({ "env": name })).expect("a task");
    let (steps, batch) = (task.spec().horizon, 2);
    let (model, data) = model_and_data(name);
    let episodes = data.images.len() / steps;
    let actions = data.actions.iter().cycle().take(episodes * steps * data.action_dim);
    let data = solar::trainer::Data {
        actions: actions.map(|&u| f64::from(u)).collect(),
        costs: Vec::new(),
        images: data.images,
        steps,
    };
    let sizes = &model.sizes;
    let ([e0, e1], [d0, d1], codes) = (sizes.encoder, sizes.decoder, 2 * sizes.latent);
    let encoder = 3.0 * dense(&[sizes.pixels, e0, e1, codes]) - dense(&[sizes.pixels, e0]);
    let decoder = 3.0 * dense(&[sizes.latent, d0, d1, sizes.pixels]);
    let gflop = 2.0 * (steps * batch) as f64 * (encoder + decoder) / 1e9;
    let mut rng = Rng::seed_from_u64(2);
    let mut solar = SolarModel::new(model.sizes, model.background, steps - 1, None, &mut rng);
    let settings = solar::trainer::Settings { learning_rate: 1e-3, clip: 5.0, dynamics_rate: 2e-5 * steps as f64 };
    let mut trainer = SolarTrainer::new(&solar, settings, steps, batch);
    let step = move || {
        let which = [0; 2].map(|_| sampling::index(&mut rng, episodes) as u32);
        std::hint::black_box(trainer.step(threads, &mut solar, &data, &which, 0.5, &mut rng));
    };
    Work { step: Box::new(step), gflop }
}

/// SOLAR's smoother on one episode of 400 steps with 8 latent components.
fn smoother() -> Work {
    let (d, m, steps) = (8, 1, 400);
    let mut rng = Rng::seed_from_u64(4);
    let dynamics: Vec<Expected> = vec![Mniw::prior(d, d + m).expected().expect("a prior"); steps - 1];
    let (mut linear, mut actions) = (vec![0.0; d * steps], vec![0.0; m * steps]);
    sampling::fill_normal(&mut rng, &mut linear);
    sampling::fill_normal(&mut rng, &mut actions);
    let precision = vec![2.0; d * steps];
    let mut chain = chain(d, m, steps);
    chain.set_dynamics(&dynamics);
    let step = move || {
        let evidence = Evidence { precision: &precision, linear: &linear };
        std::hint::black_box(chain.smooth(evidence, &actions));
    };
    // Products and factors of 8 x 8 matrices: six products, a factor and an inverse a step.
    let gflop = (steps * (6 * 2 * d * d * d + 2 * d * d * d / 3)) as f64 / 1e9;
    Work { step: Box::new(step), gflop }
}
