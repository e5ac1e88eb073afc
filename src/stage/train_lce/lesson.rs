//! One training of the representation, from a model of the round before or from random weights.

use super::params::{Networks, Params, Slopes};
use crate::{
    artifact::{TrainedModel, Transitions},
    lce::{
        BackwardSizes, ImageNetworks, LceModel, Sizes,
        model::background,
        objective::{Terms, Weights},
        refit::refit,
        trainer::{BATCH, Data, Trainer},
        warm_up::WarmUpTerms,
    },
    nn::{
        adam::{Adam, AdamSettings},
        binary_images::PooledPatches,
    },
    num::{rng::Rng, sampling},
    record::{At, topic},
    stage::{StageCx, network_sizes},
};

/// L_reg and its gradient of a transition's code, owned.
pub(super) type OwnedRegularizer<'a> = Box<dyn Fn(usize, &[f32], f32, &mut [f32]) -> f32 + Sync + 'a>;

/// What one training, and every one that begins again after it, learns from.
pub(super) struct Lesson<'a> {
    pub(super) params: &'a Params,
    pub(super) transitions: &'a Transitions,
    /// L_reg.
    pub(super) regularizer: Option<OwnedRegularizer<'a>>,
    /// Weights of the transitions, of value-guided CARL.
    pub(super) guidance: Option<Vec<f32>>,
    /// Epochs done; a training that begins again counts on.
    pub(super) epoch: u64,
    /// Steps done.
    pub(super) step: u64,
}

/// Where one training stands: which of them it is, and how much of it is warm-up and ramp.
struct Course {
    restart: u64,
    epochs: u64,
    warm_up_epochs: u64,
    ramp_epochs: u64,
}

impl Lesson<'_> {
    /// Where training stands.
    pub(super) fn now(&self, round: u32) -> At {
        At::new(round, self.epoch as u32, self.step)
    }

    /// Trains the model of the round before, without a warm-up.
    pub(super) fn go_on(&mut self, warm: TrainedModel, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        anyhow::ensure!(
            warm.model.sizes.jacobian_heads == (self.params.slopes == Slopes::Amortized),
            "`slopes` differs from what the model of `warm_start` was trained with"
        );
        let course = Course { restart: 0, epochs: self.params.epochs, warm_up_epochs: 0, ramp_epochs: 0 };
        self.train(warm, &course, cx)
    }

    /// Trains a new model; every restart has draws of its own.
    pub(super) fn begin(&mut self, restart: u64, epochs: u64, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        let &Params { warm_up_epochs, ramp_epochs, .. } = self.params;
        let sizes = network_sizes(cx.task);
        let start = fresh(self.params, self.transitions, sizes, &mut cx.rng(("weights", restart)))?;
        self.train(start, &Course { restart, epochs, warm_up_epochs, ramp_epochs }, cx)
    }

    fn train(
        &mut self,
        mut start: TrainedModel,
        course: &Course,
        cx: &mut StageCx<'_>,
    ) -> anyhow::Result<TrainedModel> {
        let (params, transitions) = (self.params, self.transitions);
        start.set_passive_dynamics(params.drift);
        let data = transitions.data(&start.model);
        let learning_rate = if course.warm_up_epochs > 0 { params.warm_up_learning_rate } else { params.learning_rate };
        let settings = AdamSettings { learning_rate, weight_decay: params.weight_decay };
        let mut trainer = Trainer::new(start.model, start.adam, settings);
        if trainer.model.sizes.patches().is_some() {
            trainer.set_dropout(params.input_dropout);
        }
        let probe = cx.map_probe();
        let steps_of_epoch = data.len().div_ceil(BATCH) as u64;
        let warm_up_ends = self.step + course.warm_up_epochs * steps_of_epoch;
        let epochs = self.epoch + course.epochs;
        for epoch in 0..course.epochs {
            let mut rng = cx.rng(("batches", course.restart << 32 | epoch));
            let order = shuffled(data.len(), &mut rng);
            let mut loss = 0.0;
            if epoch == course.warm_up_epochs {
                trainer.set_learning_rate(params.learning_rate);
            }
            for which in order.chunks(BATCH) {
                let at = self.now(cx.round);
                let threads = cx.threads.get();
                if epoch < course.warm_up_epochs {
                    let decodes = epoch >= params.anchor_epochs;
                    let terms = trainer.warm_up_step(threads, &data, which, &params.warm_up, decodes, &mut rng);
                    record_warm_up(cx, at, &terms);
                    loss = terms.prediction;
                } else {
                    let (done, ramp) = (self.step - warm_up_ends, course.ramp_epochs * steps_of_epoch);
                    let objective =
                        params.objective_at(done, ramp, self.regularizer.as_deref(), self.guidance.as_deref());
                    let terms = trainer.step(threads, &data, which, &objective, &mut rng);
                    record(cx, at, &terms, &objective.weights);
                    loss = terms.deterministic;
                }
                self.step += 1;
            }
            if epoch % params.map_every == 0 || epoch + 1 == course.epochs {
                let at = At::new(cx.round, self.epoch as u32, self.step - 1);
                probe.record(&trainer.model, cx.record, at);
                pictures(cx, at, transitions, &data, &trainer.model);
            }
            self.epoch += 1;
            cx.tick(self.epoch, epochs, &format!("decoding {loss:.1} nats"))?;
        }
        if params.refit_steps > 0 && params.slopes == Slopes::Exact {
            let codes = trainer.model.encode(&data.images);
            let rng = &mut cx.rng(("refit", course.restart));
            let (steps, learning_rate) = (params.refit_steps, params.warm_up_learning_rate);
            refit(&mut trainer.model, &codes, &data.actions, steps, learning_rate, rng);
        }
        Ok(TrainedModel { model: trainer.model, adam: trainer.adam, suspect_goals: Vec::new() })
    }
}

/// A model with random weights.
fn fresh(params: &Params, transitions: &Transitions, mut sizes: Sizes, rng: &mut Rng) -> anyhow::Result<TrainedModel> {
    sizes.jacobian_heads = params.slopes == Slopes::Amortized;
    if params.networks == Networks::PooledPatches {
        let ((rows, columns), side) = (transitions.picture, params.square as usize);
        anyhow::ensure!(
            rows % side == 0 && columns % side == 0,
            "pictures of {rows} x {columns} pixels cannot be cut into squares of {side}: change `square`"
        );
        let images = ImageNetworks::Patches(PooledPatches { columns, side });
        let (hidden, backward) = ([128; 2], BackwardSizes { z: 10, u: 10, x: 50, joint: 100 });
        sizes = Sizes { images, encoder: hidden, decoder: hidden, backward, ..sizes };
    }
    anyhow::ensure!(!transitions.is_empty(), "there are no transitions to learn from");
    let background = background(&transitions.frames(), transitions.pixels());
    let model = LceModel::new(sizes, background, rng);
    let adam = Adam::new(model.arena.len());
    Ok(TrainedModel { model, adam, suspect_goals: Vec::new() })
}

fn shuffled(count: usize, rng: &mut Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    sampling::shuffle(rng, &mut order);
    order
}

fn record_warm_up(cx: &mut StageCx<'_>, at: At, terms: &WarmUpTerms) {
    cx.record.scalars(
        topic::TRAIN_WARM_UP,
        at,
        &[
            ("encode_decode", terms.encode_decode),
            ("prediction", terms.prediction),
            ("consistency", terms.consistency),
            ("anchor", terms.anchor),
        ],
    );
}

fn record(cx: &mut StageCx<'_>, at: At, terms: &Terms, weights: &Weights) {
    cx.record.scalars(
        topic::TRAIN_LCE,
        at,
        &[
            ("total", terms.total(weights)),
            ("reconstruction", terms.reconstruction),
            ("consistency", terms.consistency()),
            ("kl_backward", terms.kl_backward),
            ("entropy", terms.entropy),
            ("log_density", terms.log_density),
            ("curvature", terms.curvature),
            ("encode_decode", terms.encode_decode),
            ("deterministic", terms.deterministic),
            ("prior", terms.prior),
            ("regularizer", terms.regularizer),
            ("anchor", terms.anchor),
            ("consistency_weight", weights.consistency),
        ],
    );
}

/// An observation beside its reconstruction, and the prediction of the next.
fn pictures(cx: &mut StageCx<'_>, at: At, transitions: &Transitions, data: &Data, model: &LceModel) {
    let which = (at.epoch as usize * 37) % data.len();
    let (height, width) = transitions.picture;
    let x = &transitions.observations[which * transitions.pixels()..][..transitions.pixels()];
    let z = model.encode_means(&model.pictures(x));
    let u = &data.actions[which * data.action_dim..][..data.action_dim];
    let next = model.predict_mean(&z, u);
    let grey = |probabilities: Vec<f32>| probabilities.iter().map(|p| (p * 255.0) as u8).collect::<Vec<u8>>();
    let (height, width) = (height as u32, width as u32);
    cx.record.picture(topic::PICTURE_OBSERVATION, at, height, width, x);
    cx.record.picture(topic::PICTURE_RECONSTRUCTION, at, height, width, &grey(model.decode(&z)));
    cx.record.picture(topic::PICTURE_PREDICTION, at, height, width, &grey(model.decode(&next)));
}
