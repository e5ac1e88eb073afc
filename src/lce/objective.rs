//! The loss of CARL, PCC and value-guided CARL, and its gradient, for one batch.
//!
//! Samples: z1 ~ E(·|x'), z_q ~ B(·|z1, u, x), z_e ~ E(·|x); F acts on (z_q, u), on (mean E(x), u) and, for the
//! curvature, around (z_e, u). One pass decodes z1 (against x'), z_e (against x) and F's mean (against x').

use super::{
    backward::{BackwardMut, BackwardPass},
    curvature::{Curvature, CurvatureMut},
    decoder::{DecoderMut, DecoderPass},
    drift::{DriftMut, DriftPass},
    encoder::{EncoderMut, EncoderPass, EncoderWeights},
    model::LceModel,
};
use crate::{
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, cut_together, over_samples},
        conv::PackedWeights,
        heads,
        mat::Accumulate,
        mlp::{Pass, PassMut},
    },
    num::{Real, simd::vectorize},
};

/// What each part of the loss is multiplied with.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Weights {
    /// -ln D(x'|z1), the decoder's part of L_p.
    pub reconstruction: f64,
    /// KL(B || E(·|x)) - H(E(·|x')) - ln F(z1|z_q, u): all of L_c, and the rest of L_p.
    pub consistency: f64,
    /// L_cur.
    pub curvature: f64,
    /// L_ed = -ln D(x|z_e).
    pub encode_decode: f64,
    /// KL(E(·|x) || N(0, I)): PCC's VAE term has it, CARL's L_ed has not.
    pub prior: f64,
    /// -ln D(x'|mean F(mean E(x), u)), "deterministic reconstruction".
    pub deterministic: f64,
    /// L_reg, see [`Regularizer`].
    pub regularizer: f64,
    /// |E(x') - E(x) - h(E(x)) - scale u|² of the means, see `warm_up`.
    pub anchor: f64,
}

/// Mean values of the parts of the loss over a batch, unweighted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Terms {
    /// -ln D(x'|z1).
    pub reconstruction: f64,
    /// KL(B(·|z1, u, x) || E(·|x)).
    pub kl_backward: f64,
    /// H(E(·|x')).
    pub entropy: f64,
    /// ln F(z1|z_q, u).
    pub log_density: f64,
    /// L_cur.
    pub curvature: f64,
    /// -ln D(x|z_e).
    pub encode_decode: f64,
    /// KL(E(·|x) || N(0, I)).
    pub prior: f64,
    /// -ln D(x'|mean F(mean E(x), u)).
    pub deterministic: f64,
    /// L_reg.
    pub regularizer: f64,
    /// The anchor.
    pub anchor: f64,
}

/// Number of entries of [`Terms`].
pub const TERMS: usize = 10;

impl Terms {
    /// Terms in the order of the fields.
    pub fn from_array(t: [f64; TERMS]) -> Self {
        let [
            reconstruction,
            kl_backward,
            entropy,
            log_density,
            curvature,
            encode_decode,
            prior,
            deterministic,
            regularizer,
            anchor,
        ] = t;
        Self {
            reconstruction,
            kl_backward,
            entropy,
            log_density,
            curvature,
            encode_decode,
            prior,
            deterministic,
            regularizer,
            anchor,
        }
    }

    /// L_c = KL(B || E) - H - ln F, the consistency loss (L_p is this plus the reconstruction).
    pub fn consistency(&self) -> f64 {
        self.kl_backward - self.entropy - self.log_density
    }

    /// The weighted sum.
    pub fn total(&self, weights: &Weights) -> f64 {
        weights.reconstruction * self.reconstruction
            + weights.consistency * self.consistency()
            + weights.curvature * self.curvature
            + weights.encode_decode * self.encode_decode
            + weights.prior * self.prior
            + weights.deterministic * self.deterministic
            + weights.regularizer * self.regularizer
            + weights.anchor * self.anchor
    }
}

/// L_reg(E, E_-, pi, x) for sample `i` of the batch: its value at the code z = mean E(x); adds `weight` times its
/// gradient to `d_z`. The old encoder and the frozen policy are the caller's affair.
pub type Regularizer<'a, T> = &'a (dyn Fn(usize, &[T], T, &mut [T]) -> T + Sync);

/// One batch: which pictures, actions and noise. Nothing of a state is in it.
#[derive(Clone, Copy)]
pub struct Batch<'a, T> {
    /// Where pictures are looked up.
    pub pictures: &'a BinaryImages,
    /// For every sample the numbers of x and x'.
    pub pairs: &'a [u32],
    /// For every sample the number of x.
    pub x: &'a [u32],
    /// Actions in -1..1, one column each.
    pub actions: &'a [T],
    /// Standard normal noise for every sample: z1, z_q, z_e, then the curvature's z and u.
    pub noise: &'a [T],
    /// The curvature's standard deviation.
    pub curvature_sigma: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
    /// Value-guided weights of L_p and L_c for every sample.
    pub guidance: Option<&'a [T]>,
    /// L_reg.
    pub regularizer: Option<Regularizer<'a, T>>,
}

impl<T> std::fmt::Debug for Batch<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Batch").field("samples", &self.x.len()).finish_non_exhaustive()
    }
}

/// Length of one sample's noise in [`Batch::noise`].
pub fn noise_width(latent: usize, action: usize) -> usize {
    4 * latent + action
}

/// Buffers for batches up to a size; a step allocates nothing.
#[derive(Debug, Clone)]
pub struct Workspace<T> {
    encoder: EncoderPass<T>,
    decoder_input: Block<T>,
    d_decoder_input: Block<T>,
    decoder: DecoderPass<T>,
    backward: BackwardPass<T>,
    dynamics_input: Block<T>,
    d_dynamics_input: Block<T>,
    dynamics: Pass<T, 3>,
    curvature: Curvature<T>,
    z1: Block<T>,
    d_z1: Block<T>,
    drift: DriftPass<T>,
    terms: Block<T>,
    shared: Shared<T>,
    gradient: Vec<T>,
}

/// What all samples of a step share besides the model: its weights as the loops read them.
#[derive(Debug, Clone)]
struct Shared<T> {
    encoder: EncoderWeights<T>,
    decoder: Vec<PackedWeights<T>>,
    backward: Vec<T>,
}

cut_together! {
    struct Columns<'a, T> {
        encoder: EncoderMut<'a, T>,
        decoder_input: BlockMut<'a, T>,
        d_decoder_input: BlockMut<'a, T>,
        decoder: DecoderMut<'a, T>,
        backward: BackwardMut<'a, T>,
        dynamics_input: BlockMut<'a, T>,
        d_dynamics_input: BlockMut<'a, T>,
        dynamics: PassMut<'a, T, 3>,
        curvature: CurvatureMut<'a, T>,
        z1: BlockMut<'a, T>,
        d_z1: BlockMut<'a, T>,
        drift: DriftMut<'a, T>,
        terms: BlockMut<'a, T>,
    }
}

impl<T: Real> Workspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let (nets, n, a) = (&model.nets, model.sizes.latent, model.sizes.action);
        Self {
            encoder: EncoderPass::new(&nets.encoder, samples, 2),
            decoder_input: Block::new(3 * n, samples),
            d_decoder_input: Block::new(3 * n, samples),
            decoder: DecoderPass::new(&nets.decoder, samples, 3),
            backward: BackwardPass::new(&nets.backward, samples),
            dynamics_input: Block::new(2 * (n + a), samples),
            d_dynamics_input: Block::new(2 * (n + a), samples),
            dynamics: Pass::new(&nets.dynamics, samples, 2),
            curvature: Curvature::new(nets, samples),
            z1: Block::new(n, samples),
            d_z1: Block::new(n, samples),
            drift: DriftPass::new(nets, samples),
            terms: Block::new(TERMS, samples),
            shared: Shared {
                encoder: nets.encoder.packed_weights(),
                decoder: nets.decoder.packed_weights(),
                backward: vec![T::ZERO; nets.backward.x.n_out],
            },
            gradient: vec![T::ZERO; nets.layout.len],
        }
    }

    fn columns(&mut self, samples: usize) -> (Columns<'_, T>, &mut Shared<T>) {
        let columns = Columns {
            encoder: self.encoder.view(samples),
            decoder_input: self.decoder_input.view(samples),
            d_decoder_input: self.d_decoder_input.view(samples),
            decoder: self.decoder.view(samples),
            backward: self.backward.view(samples),
            dynamics_input: self.dynamics_input.view(samples),
            d_dynamics_input: self.d_dynamics_input.view(samples),
            dynamics: self.dynamics.view(samples),
            curvature: self.curvature.view(samples),
            z1: self.z1.view(samples),
            d_z1: self.d_z1.view(samples),
            drift: self.drift.view(samples),
            terms: self.terms.view(samples),
        };
        (columns, &mut self.shared)
    }

    /// The gradient of the last step.
    pub fn gradient(&self) -> &[T] {
        &self.gradient
    }

    /// Values of all parts for every sample of the last step.
    pub fn sample_terms(&self, sample: usize) -> [f64; TERMS] {
        std::array::from_fn(|i| self.terms.data[sample * TERMS + i].f64())
    }

    /// The gradient of the weighted loss over a batch, and its terms.
    pub fn step(&mut self, threads: usize, model: &LceModel<T>, weights: &Weights, batch: &Batch<'_, T>) -> Terms {
        let samples = batch.x.len();
        let (nets, arena) = (&model.nets, &model.arena[..]);
        let (columns, shared) = self.columns(samples);
        nets.encoder.pack(arena, batch.pictures, &mut shared.encoder);
        nets.decoder.pack(arena, &mut shared.decoder);
        nets.backward.base(arena, batch.pictures, &mut shared.backward);
        let run = Run { model, weights, batch, shared, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, columns, &|first, samples, columns| {
            run.samples(first, samples, columns);
        });
        self.weight_gradients(threads, model, batch);
        self.mean_terms(samples)
    }

    fn weight_gradients(&mut self, threads: usize, model: &LceModel<T>, batch: &Batch<'_, T>) {
        let (nets, arena, samples) = (&model.nets, &model.arena[..], batch.x.len());
        let (gradient, shared, seen) = (&mut self.gradient[..], &self.shared, (batch.pictures, batch.pairs));
        nets.encoder.gradient(threads, (arena, &shared.encoder), gradient, seen, &mut self.encoder, samples);
        let z = self.decoder_input.view(samples).data;
        nets.decoder.gradient(threads, gradient, z, &mut self.decoder, samples);
        let inputs = (&*self.z1.view(samples).data, batch.actions);
        let backward = self.backward.view(samples);
        nets.backward.gradient(threads, gradient, inputs, (batch.pictures, batch.x), &backward);
        let z_u = self.dynamics_input.view(samples).data;
        nets.dynamics.gradient(1, gradient, Accumulate::Replace, z_u, &self.dynamics.view(samples));
        self.curvature.view(samples).add_gradient(nets, gradient);
        if let Some(drift) = &nets.drift {
            drift.gradient(gradient, &self.drift.view(samples));
        }
    }

    fn mean_terms(&self, samples: usize) -> Terms {
        let mut sums = [0.0; TERMS];
        for sample in 0..samples {
            for (sum, term) in sums.iter_mut().zip(self.sample_terms(sample)) {
                *sum += term;
            }
        }
        Terms::from_array(sums.map(|sum| sum / samples as f64))
    }
}

/// What all samples of a step share.
struct Run<'a, T> {
    model: &'a LceModel<T>,
    weights: &'a Weights,
    batch: &'a Batch<'a, T>,
    shared: &'a Shared<T>,
    mean: T,
}

impl<T: Real> Run<'_, T> {
    /// All of it under `vectorize`: outside of it every fused multiply-add would be a call.
    fn samples(&self, first: usize, samples: usize, mut c: Columns<'_, T>) {
        vectorize(
            #[inline(always)]
            || self.pass(first, samples, &mut c),
        );
    }

    #[inline(always)]
    fn pass(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        self.encode(first, samples, c);
        self.look_back(first, samples, c);
        self.predict(first, samples, c);
        nets.decoder.forward(arena, &self.shared.decoder, c.decoder_input.data, &mut c.decoder);
        self.reconstruct(first, samples, c);
        nets.decoder.backward(arena, &self.shared.decoder, &mut c.decoder, c.d_decoder_input.data);
        self.back_through_dynamics(first, samples, c);
        self.back_to_encoder(first, samples, c);
        nets.encoder.backward(arena, &mut c.encoder);
    }

    #[inline(always)]
    fn noise(&self, sample: usize) -> [&[T]; 5] {
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let noise = &self.batch.noise[sample * noise_width(n, a)..][..noise_width(n, a)];
        [&noise[..n], &noise[n..2 * n], &noise[2 * n..3 * n], &noise[3 * n..4 * n], &noise[4 * n..]]
    }

    #[inline(always)]
    fn action(&self, sample: usize) -> &[T] {
        let a = self.model.sizes.action;
        &self.batch.actions[sample * a..][..a]
    }

    /// E on x and x'; samples z1 and z_e.
    #[inline(always)]
    fn encode(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena, n) = (&self.model.nets, &self.model.arena[..], self.model.sizes.latent);
        let pairs = &self.batch.pairs[2 * first..2 * (first + samples)];
        nets.encoder.forward(arena, &self.shared.encoder, (self.batch.pictures, pairs), &mut c.encoder);
        let (codes, _) = c.encoder.codes();
        for i in 0..samples {
            let [for_z1, _, for_z_e, ..] = self.noise(first + i);
            let (now, next) = codes[4 * n * i..][..4 * n].split_at(2 * n);
            heads::sample(next, for_z1, c.z1.sample(i));
            let decoder_input = c.decoder_input.sample(i);
            decoder_input[..n].copy_from_slice(c.z1.sample(i));
            heads::sample(now, for_z_e, &mut decoder_input[n..2 * n]);
        }
    }

    /// B on (z1, u, x); samples z_q into the first of F's inputs, the mean of E(x) into the second.
    #[inline(always)]
    fn look_back(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let u = &self.batch.actions[first * a..(first + samples) * a];
        let x = &self.batch.x[first..first + samples];
        let seen = (self.batch.pictures, &self.shared.backward[..], x);
        nets.backward.forward(arena, (c.z1.data, u), seen, &mut c.backward);
        for i in 0..samples {
            let [_, for_z_q, ..] = self.noise(first + i);
            let (from_z_q, from_mean) = c.dynamics_input.sample(i).split_at_mut(n + a);
            heads::sample(c.backward.gaussian(i), for_z_q, &mut from_z_q[..n]);
            from_mean[..n].copy_from_slice(&c.encoder.codes().0[4 * n * i..][..n]);
            from_z_q[n..].copy_from_slice(self.action(first + i));
            from_mean[n..].copy_from_slice(self.action(first + i));
        }
    }

    /// F on (z_q, u) and (mean E(x), u), its means made absolute; the curvature around (z_e, u).
    #[inline(always)]
    fn predict(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        nets.dynamics.forward(arena, c.dynamics_input.data, &mut c.dynamics);
        for (gaussian, input) in
            c.dynamics.out[2].chunks_exact_mut(2 * n).zip(c.dynamics_input.data.chunks_exact(n + a))
        {
            for i in 0..n {
                gaussian[i] += input[i];
            }
        }
        for i in 0..samples {
            let mean = &c.dynamics.out[2][4 * n * i + 2 * n..][..n];
            c.decoder_input.sample(i)[2 * n..].copy_from_slice(mean);
        }
        let sigma = T::of(self.batch.curvature_sigma);
        for i in 0..samples {
            let [.., e_z, e_u] = self.noise(first + i);
            let point = [&c.decoder_input.sample(i)[n..2 * n], self.action(first + i)];
            c.curvature.set(i, point, [e_z, e_u], sigma);
        }
        let terms = &mut c.terms;
        c.curvature.run(nets, arena, T::of(self.weights.curvature) * self.mean, |i, value| terms.sample(i)[4] = value);
    }

    /// The decoder's three losses and the deltas of its logits.
    #[inline(always)]
    fn reconstruct(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let entries = self.model.sizes.entries();
        let Weights { reconstruction, encode_decode, deterministic, .. } = *self.weights;
        for i in 0..samples {
            let [x, next] = [0, 1].map(|k| self.batch.pairs[2 * (first + i) + k]);
            let guided = T::of(reconstruction) * self.guidance(first + i);
            let parts = [(next, guided, 0), (x, T::of(encode_decode), 5), (next, T::of(deterministic), 7)];
            for (k, (picture, weight, term)) in parts.into_iter().enumerate() {
                let range = (3 * i + k) * entries..(3 * i + k + 1) * entries;
                let (logits, delta) = c.decoder.logits();
                let (logits, delta) = (&logits[range.clone()], &mut delta[range]);
                let value = heads::bernoulli(logits, self.batch.pictures, picture, weight * self.mean, delta);
                c.terms.sample(i)[term] = value;
            }
        }
    }

    #[inline(always)]
    fn guidance(&self, sample: usize) -> T {
        self.batch.guidance.map_or(T::ONE, |guidance| guidance[sample])
    }

    /// ln F(z1|z_q, u) and the deltas of F's two heads, back to z_q and the mean of E(x).
    #[inline(always)]
    fn back_through_dynamics(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena, n) = (&self.model.nets, &self.model.arena[..], self.model.sizes.latent);
        c.dynamics.delta[2].fill(T::ZERO);
        for i in 0..samples {
            let weight = T::of(-self.weights.consistency) * self.guidance(first + i) * self.mean;
            let d_z1 = c.d_z1.sample(i);
            let d_decoded = c.d_decoder_input.sample(i);
            d_z1.copy_from_slice(&d_decoded[..n]);
            let gaussian = &c.dynamics.out[2][4 * n * i..][..2 * n];
            let (d_from_z_q, d_from_mean) = c.dynamics.delta[2][4 * n * i..][..4 * n].split_at_mut(2 * n);
            c.terms.sample(i)[3] = heads::log_density(c.z1.sample(i), gaussian, weight, d_z1, d_from_z_q);
            d_from_mean[..n].copy_from_slice(&d_decoded[2 * n..]);
        }
        nets.dynamics.backward(arena, &mut c.dynamics, Some(c.d_dynamics_input.data));
    }

    /// The Gaussians' own losses, and everything that flows back into E and B.
    #[inline(always)]
    fn back_to_encoder(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        for i in 0..samples {
            let consistency = T::of(self.weights.consistency) * self.guidance(first + i) * self.mean;
            let [_, for_z_q, for_z_e, ..] = self.noise(first + i);
            let (codes, d_codes) = c.encoder.codes();
            let (now, d_now) = (&codes[4 * n * i..][..2 * n], &mut d_codes[4 * n * i..][..2 * n]);
            d_now.fill(T::ZERO);
            let (d_input_z_q, d_input_mean) = c.d_dynamics_input.sample(i).split_at_mut(n + a);
            let d_heads = &c.dynamics.delta[2][4 * n * i..][..4 * n];
            for k in 0..n {
                // F's means are relative to their input, so its gradient passes straight through as well.
                d_input_z_q[k] += d_heads[k];
                d_now[k] += d_input_mean[k] + d_heads[2 * n + k];
            }
            heads::sample_backward(now, for_z_e, &c.d_decoder_input.sample(i)[n..2 * n], d_now);
            let terms = c.terms.sample(i);
            let (gaussian, d_gaussian) = c.backward.gaussian_and_gradient(i);
            d_gaussian.fill(T::ZERO);
            terms[1] = heads::kl(gaussian, now, consistency, d_gaussian, d_now);
            heads::sample_backward(gaussian, for_z_q, &d_input_z_q[..n], d_gaussian);
            terms[6] = heads::kl_to_unit(now, T::of(self.weights.prior) * self.mean, d_now);
            if let Some(regularizer) = self.batch.regularizer {
                let weight = T::of(self.weights.regularizer) * self.mean;
                terms[8] = regularizer(first + i, &now[..n], weight, &mut d_now[..n]);
            }
        }
        nets.backward.backward(arena, &mut c.backward, c.d_z1.data);
        if let Some(drift) = &nets.drift {
            drift.forward(arena, c.encoder.codes().0, &mut c.drift);
        }
        for i in 0..samples {
            let consistency = T::of(self.weights.consistency) * self.guidance(first + i) * self.mean;
            let [for_z1, ..] = self.noise(first + i);
            let (codes, d_codes) = c.encoder.codes();
            let (codes, d_codes) = (&codes[4 * n * i..][..4 * n], &mut d_codes[4 * n * i..][..4 * n]);
            let (next, d_next) = (&codes[2 * n..], &mut d_codes[2 * n..]);
            d_next.fill(T::ZERO);
            heads::sample_backward(next, for_z1, c.d_z1.sample(i), d_next);
            let terms = c.terms.sample(i);
            terms[2] = heads::entropy(next, -consistency, d_next);
            let weight = T::of(self.weights.anchor) * self.mean;
            let scale = T::of(self.batch.anchor_scale);
            terms[9] = anchor(n, self.action(first + i), scale, (codes, d_codes), c.drift.sample(i), weight);
        }
        if let Some(drift) = &nets.drift {
            let (codes, d_codes) = c.encoder.codes();
            drift.backward(arena, codes, &mut c.drift, d_codes);
        }
    }
}

/// |E(x') - E(x) - h - scale \[u; 0\]|² of the means; adds `weight` times its gradient to both codes and sets h's.
#[inline(always)]
fn anchor<T: Real>(
    latent: usize,
    action: &[T],
    scale: T,
    (codes, d_codes): (&[T], &mut [T]),
    (h, d_h): (&[T], &mut [T]),
    weight: T,
) -> T {
    let (now, next) = codes.split_at(2 * latent);
    let (d_now, d_next) = d_codes.split_at_mut(2 * latent);
    let or_zero = |x: Option<&T>| x.map_or(T::ZERO, |&x| x);
    let mut sum = T::ZERO;
    for i in 0..latent {
        let rest = next[i] - now[i] - scale * or_zero(action.get(i)) - or_zero(h.get(i));
        let slope = weight * (rest + rest);
        d_next[i] += slope;
        d_now[i] -= slope;
        if let Some(d_h) = d_h.get_mut(i) {
            *d_h = -slope;
        }
        sum += rest * rest;
    }
    sum
}
