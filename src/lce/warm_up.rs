//! The anchored warm-up: a predictive autoencoder whose code moves by a fixed vector for every unit of action.
//!
//! From random weights the paper's loss collapses: the encoder's noise grows until the code says nothing. This loss has
//! one optimum, a code affine in the position, that can neither collapse nor fold. Where a code also moves by itself, a
//! [`Drift`](super::Drift) takes that up, and the action's vector stays the same everywhere. It uses (x, u, x') alone.

use super::{
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

/// Constants of the warm-up loss.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WarmUp {
    /// Standard deviation of the noise on codes, s; the encoder's own is pulled towards it.
    pub sigma: f64,
    /// How far one unit of action (its limit) moves the code.
    pub scale: f64,
    /// Weight of the anchor.
    pub anchor: f64,
    /// Beyond this many s the anchor grows linearly, since a blocked move is an outlier and no lie about the map.
    pub outlier: f64,
    /// Weight of |z|².
    pub shrink: f64,
}

impl Default for WarmUp {
    fn default() -> Self {
        Self { sigma: 0.3, scale: 1.0, anchor: 30.0, outlier: 3.0, shrink: 0.01 }
    }
}

/// Mean values of the parts over a batch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WarmUpTerms {
    /// -ln D(x|E(x) + s e).
    pub encode_decode: f64,
    /// -ln D(x'|F(E(x), u) + s e).
    pub prediction: f64,
    /// |F(E(x), u) - E(x')|² / 2s².
    pub consistency: f64,
    /// The anchor.
    pub anchor: f64,
}

/// One batch of the warm-up; noise is standard normal, two codes for every sample.
#[derive(Debug, Clone, Copy)]
pub struct WarmUpBatch<'a, T> {
    /// Where pictures are looked up.
    pub pictures: &'a BinaryImages,
    /// For every sample the numbers of x and x'.
    pub pairs: &'a [u32],
    /// Actions in -1..1, one column each.
    pub actions: &'a [T],
    /// Standard normal noise, two codes for every sample.
    pub noise: &'a [T],
    /// Whether pictures are decoded. Without it only the geometry is learned, several times as fast.
    pub decode: bool,
}

/// Buffers for batches up to a size; a step allocates nothing.
#[derive(Debug, Clone)]
pub struct WarmUpWorkspace<T> {
    encoder: EncoderPass<T>,
    decoder_input: Block<T>,
    d_decoder_input: Block<T>,
    decoder: DecoderPass<T>,
    dynamics_input: Block<T>,
    d_dynamics_input: Block<T>,
    dynamics: Pass<T, 3>,
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
}

cut_together! {
    struct Columns<'a, T> {
        encoder: EncoderMut<'a, T>,
        decoder_input: BlockMut<'a, T>,
        d_decoder_input: BlockMut<'a, T>,
        decoder: DecoderMut<'a, T>,
        dynamics_input: BlockMut<'a, T>,
        d_dynamics_input: BlockMut<'a, T>,
        dynamics: PassMut<'a, T, 3>,
        drift: DriftMut<'a, T>,
        terms: BlockMut<'a, T>,
    }
}

impl<T: Real> WarmUpWorkspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let (nets, n, a) = (&model.nets, model.sizes.latent, model.sizes.action);
        Self {
            encoder: EncoderPass::new(&nets.encoder, samples, 2),
            decoder_input: Block::new(2 * n, samples),
            d_decoder_input: Block::new(2 * n, samples),
            decoder: DecoderPass::new(&nets.decoder, samples, 2),
            dynamics_input: Block::new(n + a, samples),
            d_dynamics_input: Block::new(n + a, samples),
            dynamics: Pass::new(&nets.dynamics, samples, 1),
            drift: DriftPass::new(nets, samples),
            terms: Block::new(4, samples),
            shared: Shared { encoder: nets.encoder.packed_weights(), decoder: nets.decoder.packed_weights() },
            gradient: vec![T::ZERO; nets.layout.len],
        }
    }

    fn columns(&mut self, samples: usize) -> (Columns<'_, T>, &mut Shared<T>) {
        let columns = Columns {
            encoder: self.encoder.view(samples),
            decoder_input: self.decoder_input.view(samples),
            d_decoder_input: self.d_decoder_input.view(samples),
            decoder: self.decoder.view(samples),
            dynamics_input: self.dynamics_input.view(samples),
            d_dynamics_input: self.d_dynamics_input.view(samples),
            dynamics: self.dynamics.view(samples),
            drift: self.drift.view(samples),
            terms: self.terms.view(samples),
        };
        (columns, &mut self.shared)
    }

    /// The gradient of the last step; that of B's parameters is zero.
    pub fn gradient(&self) -> &[T] {
        &self.gradient
    }

    /// The gradient of the warm-up loss over a batch.
    pub fn step(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        settings: &WarmUp,
        batch: &WarmUpBatch<'_, T>,
    ) -> WarmUpTerms {
        let samples = batch.pairs.len() / 2;
        let (columns, shared) = self.columns(samples);
        model.nets.encoder.pack(&model.arena, batch.pictures, &mut shared.encoder);
        if batch.decode {
            model.nets.decoder.pack(&model.arena, &mut shared.decoder);
        }
        let run = Run { model, settings, batch, shared, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, columns, &|first, samples, columns| {
            run.samples(first, samples, columns);
        });
        self.weight_gradients(threads, model, batch);
        let mut sums = [0.0; 4];
        for terms in self.terms.data[..4 * samples].chunks_exact(4) {
            for (sum, &term) in sums.iter_mut().zip(terms) {
                *sum += term.f64() / samples as f64;
            }
        }
        let [encode_decode, prediction, consistency, anchor] = sums;
        WarmUpTerms { encode_decode, prediction, consistency, anchor }
    }

    fn weight_gradients(&mut self, threads: usize, model: &LceModel<T>, batch: &WarmUpBatch<'_, T>) {
        let (nets, arena, samples) = (&model.nets, &model.arena[..], batch.pairs.len() / 2);
        let (gradient, shared) = (&mut self.gradient[..], &self.shared);
        let seen = (batch.pictures, batch.pairs);
        nets.encoder.gradient(threads, (arena, &shared.encoder), gradient, seen, &mut self.encoder, samples);
        if batch.decode {
            let z = self.decoder_input.view(samples).data;
            nets.decoder.gradient(threads, gradient, z, &mut self.decoder, samples);
        } else {
            gradient[nets.decoder.parameters()].fill(T::ZERO);
        }
        let z_u = self.dynamics_input.view(samples).data;
        nets.dynamics.gradient(1, gradient, Accumulate::Replace, z_u, &self.dynamics.view(samples));
        if let Some(drift) = &nets.drift {
            drift.gradient(gradient, &self.drift.view(samples));
        }
    }
}

struct Run<'a, T> {
    model: &'a LceModel<T>,
    settings: &'a WarmUp,
    batch: &'a WarmUpBatch<'a, T>,
    shared: &'a Shared<T>,
    mean: T,
}

impl<T: Real> Run<'_, T> {
    fn samples(&self, first: usize, samples: usize, mut c: Columns<'_, T>) {
        vectorize(
            #[inline(always)]
            || self.pass(first, samples, &mut c),
        );
    }

    #[inline(always)]
    fn pass(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        self.forward(first, samples, c);
        if self.batch.decode {
            nets.decoder.forward(arena, &self.shared.decoder, c.decoder_input.data, &mut c.decoder);
            self.reconstruct(first, samples, c);
            nets.decoder.backward(arena, &self.shared.decoder, &mut c.decoder, c.d_decoder_input.data);
        } else {
            c.d_decoder_input.data.fill(T::ZERO);
            c.terms.data.fill(T::ZERO);
        }
        self.backward(first, samples, c);
        nets.encoder.backward(arena, &mut c.encoder);
    }

    #[inline(always)]
    fn forward(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let pairs = &self.batch.pairs[2 * first..2 * (first + samples)];
        nets.encoder.forward(arena, &self.shared.encoder, (self.batch.pictures, pairs), &mut c.encoder);
        let (codes, _) = c.encoder.codes();
        for i in 0..samples {
            let (z, u) = c.dynamics_input.sample(i).split_at_mut(n);
            z.copy_from_slice(&codes[4 * n * i..][..n]);
            u.copy_from_slice(&self.batch.actions[(first + i) * a..][..a]);
        }
        nets.dynamics.forward(arena, c.dynamics_input.data, &mut c.dynamics);
        let sigma = T::of(self.settings.sigma);
        for i in 0..samples {
            let noise = &self.batch.noise[(first + i) * 2 * n..][..2 * n];
            let z = &codes[4 * n * i..][..n];
            let predicted = &mut c.dynamics.out[2][2 * n * i..][..n];
            let decoded = c.decoder_input.sample(i);
            for k in 0..n {
                predicted[k] += z[k];
                decoded[k] = sigma.fma(noise[k], z[k]);
                decoded[n + k] = sigma.fma(noise[n + k], predicted[k]);
            }
        }
    }

    #[inline(always)]
    fn reconstruct(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let entries = self.model.sizes.entries();
        for column in 0..2 * samples {
            let picture = self.batch.pairs[2 * first + column];
            let range = column * entries..(column + 1) * entries;
            let (logits, delta) = c.decoder.logits();
            let (logits, delta) = (&logits[range.clone()], &mut delta[range]);
            let value = heads::bernoulli(logits, self.batch.pictures, picture, self.mean, delta);
            c.terms.sample(column / 2)[column % 2] = value;
        }
    }

    #[inline(always)]
    fn backward(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let s = self.settings;
        let inverse = T::of(1.0 / (s.sigma * s.sigma)) * self.mean;
        c.dynamics.delta[2].fill(T::ZERO);
        let (codes, d_codes) = c.encoder.codes();
        d_codes.fill(T::ZERO);
        for i in 0..samples {
            let (next, d_next) = (&codes[4 * n * i + 2 * n..][..n], &mut d_codes[4 * n * i + 2 * n..][..n]);
            let predicted = &c.dynamics.out[2][2 * n * i..][..n];
            let d_predicted = &mut c.dynamics.delta[2][2 * n * i..][..n];
            let d_decoded = &c.d_decoder_input.sample(i)[n..];
            let mut sum = T::ZERO;
            for k in 0..n {
                let rest = predicted[k] - next[k];
                sum += rest * rest;
                d_predicted[k] = d_decoded[k] + inverse * rest;
                d_next[k] -= inverse * rest;
            }
            c.terms.sample(i)[2] = sum * T::of(0.5 / (s.sigma * s.sigma));
        }
        nets.dynamics.backward(arena, &mut c.dynamics, Some(c.d_dynamics_input.data));
        if let Some(drift) = &nets.drift {
            drift.forward(arena, codes, &mut c.drift);
        }
        for i in 0..samples {
            let (codes, d_codes) = (&codes[4 * n * i..][..4 * n], &mut d_codes[4 * n * i..][..4 * n]);
            for k in 0..n {
                d_codes[k] += c.dynamics.delta[2][2 * n * i + k]
                    + c.d_dynamics_input.sample(i)[k]
                    + c.d_decoder_input.sample(i)[k];
            }
            let action = &self.batch.actions[(first + i) * a..][..a];
            c.terms.sample(i)[3] = robust_anchor(n, action, s, (codes, d_codes), c.drift.sample(i), self.mean);
            let target = T::of(s.sigma).log();
            for (code, d_code) in codes.chunks_exact(2 * n).zip(d_codes.chunks_exact_mut(2 * n)) {
                for k in 0..n {
                    let shrink = T::of(2.0 * s.shrink) * self.mean;
                    d_code[k] = shrink.fma(code[k], d_code[k]);
                    let rest = code[n + k] - target;
                    d_code[n + k] += (rest + rest) * self.mean;
                }
            }
        }
        if let Some(drift) = &nets.drift {
            drift.backward(arena, codes, &mut c.drift, d_codes);
        }
    }
}

/// The anchor on the codes of x and x': with r = (E(x') - E(x) - h - scale \[u; 0\]) / s, the pseudo-Huber loss
/// o² (sqrt(1 + |r|²/o²) - 1), which is |r|²/2 for |r| well below the outlier distance o.
#[inline(always)]
fn robust_anchor<T: Real>(
    n: usize,
    action: &[T],
    s: &WarmUp,
    (codes, d_codes): (&[T], &mut [T]),
    (h, d_h): (&[T], &mut [T]),
    mean: T,
) -> T {
    let (now, next) = codes.split_at(2 * n);
    let (d_now, d_next) = d_codes.split_at_mut(2 * n);
    let scale = T::of(s.scale);
    let or_zero = |x: Option<&T>| x.map_or(T::ZERO, |&x| x);
    let rest = |k: usize| next[k] - now[k] - scale * or_zero(action.get(k)) - or_zero(h.get(k));
    let squared = (0..n).map(|k| rest(k) * rest(k)).fold(T::ZERO, |sum, x| sum + x);
    let outlier = T::of(s.outlier * s.outlier);
    let inverse = T::of(1.0 / (s.sigma * s.sigma));
    let root = (T::ONE + squared * inverse / outlier).root();
    let slope = mean * T::of(s.anchor) * inverse / root;
    for k in 0..n {
        d_next[k] += slope * rest(k);
        d_now[k] -= slope * rest(k);
    }
    for (k, d_h) in d_h.iter_mut().enumerate() {
        *d_h = -slope * rest(k);
    }
    T::of(s.anchor) * outlier * (root - T::ONE)
}
