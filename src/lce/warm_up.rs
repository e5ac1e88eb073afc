//! The anchored warm-up: a predictive autoencoder whose code moves by a fixed vector for every unit of action.
//!
//! From random weights the paper's loss collapses: the encoder's noise grows until the code says nothing. This loss has
//! one optimum, a code affine in the position, that can neither collapse nor fold. It uses (x, u, x') alone.

use super::model::LceModel;
use crate::nn::{
    Real,
    columns::{Block, BlockMut, cut_together, over_samples},
    heads,
    mat::Into,
    mlp::{Pass, PassMut},
    pictures::{Pictures, Place},
    vectorize,
};

/// Constants of the warm-up loss.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
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
    pub pictures: &'a Pictures,
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
    encoder: Pass<T, 3>,
    decoder_input: Block<T>,
    d_decoder_input: Block<T>,
    decoder: Pass<T, 3>,
    dynamics_input: Block<T>,
    d_dynamics_input: Block<T>,
    dynamics: Pass<T, 3>,
    terms: Block<T>,
    base: Vec<T>,
    gradient: Vec<T>,
}

cut_together! {
    struct Columns<'a, T> {
        encoder: PassMut<'a, T, 3>,
        decoder_input: BlockMut<'a, T>,
        d_decoder_input: BlockMut<'a, T>,
        decoder: PassMut<'a, T, 3>,
        dynamics_input: BlockMut<'a, T>,
        d_dynamics_input: BlockMut<'a, T>,
        dynamics: PassMut<'a, T, 3>,
        terms: BlockMut<'a, T>,
    }
}

impl<T: Real> WarmUpWorkspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let (nets, n, a) = (&model.nets, model.sizes.latent, model.sizes.action);
        Self {
            encoder: Pass::new(&nets.encoder, samples, 2),
            decoder_input: Block::new(2 * n, samples),
            d_decoder_input: Block::new(2 * n, samples),
            decoder: Pass::new(&nets.decoder, samples, 2),
            dynamics_input: Block::new(n + a, samples),
            d_dynamics_input: Block::new(n + a, samples),
            dynamics: Pass::new(&nets.dynamics, samples, 1),
            terms: Block::new(4, samples),
            base: vec![T::nil(); nets.encoder.layers[0].n_out],
            gradient: vec![T::nil(); nets.layout.len],
        }
    }

    fn columns(&mut self, samples: usize) -> Columns<'_, T> {
        Columns {
            encoder: self.encoder.view(samples),
            decoder_input: self.decoder_input.view(samples),
            d_decoder_input: self.d_decoder_input.view(samples),
            decoder: self.decoder.view(samples),
            dynamics_input: self.dynamics_input.view(samples),
            d_dynamics_input: self.d_dynamics_input.view(samples),
            dynamics: self.dynamics.view(samples),
            terms: self.terms.view(samples),
        }
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
        let mut base = std::mem::take(&mut self.base);
        batch.pictures.base(&model.nets.encoder.layers[0], &model.arena, &mut base);
        let run = Run { model, settings, batch, base: &base, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, self.columns(samples), &|first, samples, columns| {
            run.samples(first, samples, columns);
        });
        self.base = base;
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
        let nets = &model.nets;
        let mut gradient = std::mem::take(&mut self.gradient);
        let c = self.columns(batch.pairs.len() / 2);
        let first = &nets.encoder.layers[0];
        let place = Place { stride: first.n_out, offset: 0 };
        batch.pictures.gradient(threads, first, &mut gradient, batch.pairs, c.encoder.delta[0], place);
        nets.encoder.gradient_from_second(threads, &mut gradient, Into::Replace, &c.encoder);
        if batch.decode {
            nets.decoder.gradient(threads, &mut gradient, Into::Replace, c.decoder_input.data, &c.decoder);
        } else {
            let [first, .., last] = nets.decoder.layers;
            gradient[first.at..last.at + last.len()].fill(T::nil());
        }
        nets.dynamics.gradient(1, &mut gradient, Into::Replace, c.dynamics_input.data, &c.dynamics);
        self.gradient = gradient;
    }
}

struct Run<'a, T> {
    model: &'a LceModel<T>,
    settings: &'a WarmUp,
    batch: &'a WarmUpBatch<'a, T>,
    base: &'a [T],
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
            nets.decoder.forward(arena, c.decoder_input.data, &mut c.decoder);
            self.reconstruct(first, samples, c);
            nets.decoder.backward(arena, &mut c.decoder, Some(c.d_decoder_input.data));
        } else {
            c.d_decoder_input.data.fill(T::nil());
            c.terms.data.fill(T::nil());
        }
        self.backward(first, samples, c);
        nets.encoder.backward(arena, &mut c.encoder, None);
    }

    #[inline(always)]
    fn forward(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let layer = &nets.encoder.layers[0];
        let place = Place { stride: layer.n_out, offset: 0 };
        let pairs = &self.batch.pairs[2 * first..2 * (first + samples)];
        self.batch.pictures.affine(layer, arena, self.base, pairs, c.encoder.out[0], place, true);
        nets.encoder.forward_from_second(arena, &mut c.encoder);
        for i in 0..samples {
            let (z, u) = c.dynamics_input.of(i).split_at_mut(n);
            z.copy_from_slice(&c.encoder.out[2][4 * n * i..][..n]);
            u.copy_from_slice(&self.batch.actions[(first + i) * a..][..a]);
        }
        nets.dynamics.forward(arena, c.dynamics_input.data, &mut c.dynamics);
        let sigma = T::of(self.settings.sigma);
        for i in 0..samples {
            let noise = &self.batch.noise[(first + i) * 2 * n..][..2 * n];
            let z = &c.encoder.out[2][4 * n * i..][..n];
            let predicted = &mut c.dynamics.out[2][2 * n * i..][..n];
            let decoded = c.decoder_input.of(i);
            for k in 0..n {
                predicted[k] += z[k];
                decoded[k] = sigma.fma(noise[k], z[k]);
                decoded[n + k] = sigma.fma(noise[n + k], predicted[k]);
            }
        }
    }

    #[inline(always)]
    fn reconstruct(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let pixels = self.model.sizes.pixels;
        for column in 0..2 * samples {
            let picture = self.batch.pairs[2 * first + column];
            let range = column * pixels..(column + 1) * pixels;
            let logits = &c.decoder.out[2][range.clone()];
            let delta = &mut c.decoder.delta[2][range];
            let value = heads::bernoulli(logits, self.batch.pictures, picture, self.mean, delta);
            c.terms.of(column / 2)[column % 2] = value;
        }
    }

    #[inline(always)]
    fn backward(&self, first: usize, samples: usize, c: &mut Columns<'_, T>) {
        let (nets, arena) = (&self.model.nets, &self.model.arena[..]);
        let (n, a) = (self.model.sizes.latent, self.model.sizes.action);
        let s = self.settings;
        let inverse = T::of(1.0 / (s.sigma * s.sigma)) * self.mean;
        c.dynamics.delta[2].fill(T::nil());
        c.encoder.delta[2].fill(T::nil());
        for i in 0..samples {
            let next = &c.encoder.out[2][4 * n * i + 2 * n..][..n];
            let d_next = &mut c.encoder.delta[2][4 * n * i + 2 * n..][..n];
            let predicted = &c.dynamics.out[2][2 * n * i..][..n];
            let d_predicted = &mut c.dynamics.delta[2][2 * n * i..][..n];
            let d_decoded = &c.d_decoder_input.of(i)[n..];
            let mut sum = T::nil();
            for k in 0..n {
                let rest = predicted[k] - next[k];
                sum += rest * rest;
                d_predicted[k] = d_decoded[k] + inverse * rest;
                d_next[k] -= inverse * rest;
            }
            c.terms.of(i)[2] = sum * T::of(0.5 / (s.sigma * s.sigma));
        }
        nets.dynamics.backward(arena, &mut c.dynamics, Some(c.d_dynamics_input.data));
        for i in 0..samples {
            let codes = &c.encoder.out[2][4 * n * i..][..4 * n];
            let d_codes = &mut c.encoder.delta[2][4 * n * i..][..4 * n];
            for k in 0..n {
                d_codes[k] +=
                    c.dynamics.delta[2][2 * n * i + k] + c.d_dynamics_input.of(i)[k] + c.d_decoder_input.of(i)[k];
            }
            let action = &self.batch.actions[(first + i) * a..][..a];
            c.terms.of(i)[3] = robust_anchor(n, action, s, codes, self.mean, d_codes);
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
    }
}

/// The anchor on the codes of x and x': with r = (E(x') - E(x) - scale \[u; 0\]) / s, the pseudo-Huber loss
/// o² (sqrt(1 + |r|²/o²) - 1), which is |r|²/2 for |r| well below the outlier distance o.
#[inline(always)]
fn robust_anchor<T: Real>(n: usize, action: &[T], s: &WarmUp, codes: &[T], mean: T, d_codes: &mut [T]) -> T {
    let (now, next) = codes.split_at(2 * n);
    let (d_now, d_next) = d_codes.split_at_mut(2 * n);
    let scale = T::of(s.scale);
    let rest = |k: usize| next[k] - now[k] - action.get(k).map_or(T::nil(), |&u| scale * u);
    let squared = (0..n).map(|k| rest(k) * rest(k)).fold(T::nil(), |sum, x| sum + x);
    let outlier = T::of(s.outlier * s.outlier);
    let inverse = T::of(1.0 / (s.sigma * s.sigma));
    let root = (T::unit() + squared * inverse / outlier).root();
    let slope = mean * T::of(s.anchor) * inverse / root;
    for k in 0..n {
        d_next[k] += slope * rest(k);
        d_now[k] -= slope * rest(k);
    }
    T::of(s.anchor) * outlier * (root - T::unit())
}
