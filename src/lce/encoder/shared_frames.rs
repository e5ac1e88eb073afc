//! The encoder that reads each frame by the same network.

use crate::{
    lce::shared_frames::{Differences, FRAMES, SharedFrames},
    nn::{
        binary_images::BinaryImages,
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass, PassMut},
    },
    num::Real,
};

/// Where the layers are in the arena. The log standard deviations are an affine function of the last hidden layers of
/// both frames.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedFrameEncoder {
    /// g.
    frame: Mlp<3>,
    log_sigma: Linear,
    differences: Option<ScaledDifferences>,
}

/// The differences of a code: scale (g(new) - g(old)), or scale times an affine function of it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ScaledDifferences {
    scale: f64,
    mixing: Option<Linear>,
}

impl SharedFrameEncoder {
    /// Lays out the encoder for observations of `entries` patches.
    pub(super) fn new(layout: &mut Layout, frames: SharedFrames, entries: usize, [first, second]: [usize; 2]) -> Self {
        let m = frames.coordinates;
        let frame = layout.mlp("encoder", entries / FRAMES, [first, second, m]);
        let log_sigma = layout.linear("encoder.log_sigma", FRAMES * second, frames.latent());
        let differences = match frames.differences {
            Differences::None => None,
            Differences::Scaled { scale } => Some(ScaledDifferences { scale, mixing: None }),
            Differences::Mixed { scale, coordinates } => {
                Some(ScaledDifferences { scale, mixing: Some(layout.linear("encoder.mixing", m, coordinates)) })
            }
        };
        Self { frame, log_sigma, differences }
    }

    /// The layer that puts out the log standard deviations.
    pub(super) fn log_sigma(&self) -> Linear {
        self.log_sigma
    }

    fn coordinates(&self) -> usize {
        self.frame.layers[2].n_out
    }

    fn latent(&self) -> usize {
        self.log_sigma.n_out
    }

    fn mixing(&self) -> Option<Linear> {
        self.differences.and_then(|differences| differences.mixing)
    }
}

/// Buffers for a batch. The frames of an observation are columns of g, the older one first.
#[derive(Debug, Clone)]
pub(in crate::lce) struct SharedFrameEncoderPass<T> {
    net: SharedFrameEncoder,
    /// The start of every column of the first layer: its biases, since patches have a dark reference.
    base: Vec<T>,
    frame: Pass<T, 3>,
    log_sigma: Block<T>,
    d_log_sigma: Block<T>,
    /// The gradient with respect to the last hidden layers, through the log standard deviations.
    d_hidden: Block<T>,
    /// g(new) - g(old).
    differences: Block<T>,
    d_differences: Block<T>,
    /// The affine function of the differences, where they are mixed.
    mixed: Block<T>,
    d_mixed: Block<T>,
    codes: Block<T>,
    d_codes: Block<T>,
}

cut_together! {
    /// Some samples of a [`SharedFrameEncoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct SharedFrameEncoderColumns<'a, T> {
        net: &'a SharedFrameEncoder,
        base: &'a [T],
        frame: PassMut<'a, T, 3>,
        log_sigma: BlockMut<'a, T>,
        d_log_sigma: BlockMut<'a, T>,
        d_hidden: BlockMut<'a, T>,
        differences: BlockMut<'a, T>,
        d_differences: BlockMut<'a, T>,
        mixed: BlockMut<'a, T>,
        d_mixed: BlockMut<'a, T>,
        codes: BlockMut<'a, T>,
        d_codes: BlockMut<'a, T>,
    }
}

impl<T: Real> SharedFrameEncoderPass<T> {
    pub(super) fn new(net: &SharedFrameEncoder, samples: usize, each: usize) -> Self {
        let block = |width: usize| Block::new(width * each, samples);
        let mixed = net.mixing().map_or(0, |mixing| mixing.n_out);
        Self {
            base: vec![T::ZERO; net.frame.layers[0].n_out],
            frame: Pass::new(&net.frame, samples, FRAMES * each),
            log_sigma: block(net.latent()),
            d_log_sigma: block(net.latent()),
            d_hidden: block(net.log_sigma.n_in),
            differences: block(net.coordinates()),
            d_differences: block(net.coordinates()),
            mixed: block(mixed),
            d_mixed: block(mixed),
            codes: block(2 * net.latent()),
            d_codes: block(2 * net.latent()),
            net: net.clone(),
        }
    }

    pub(super) fn pack(&mut self, arena: &[T], images: &BinaryImages) {
        images.base(&self.net.frame.layers[0], arena, &mut self.base);
    }

    pub(super) fn view(&mut self, samples: usize) -> SharedFrameEncoderColumns<'_, T> {
        SharedFrameEncoderColumns {
            net: &self.net,
            base: &self.base,
            frame: self.frame.view(samples),
            log_sigma: self.log_sigma.view(samples),
            d_log_sigma: self.d_log_sigma.view(samples),
            d_hidden: self.d_hidden.view(samples),
            differences: self.differences.view(samples),
            d_differences: self.d_differences.view(samples),
            mixed: self.mixed.view(samples),
            d_mixed: self.d_mixed.view(samples),
            codes: self.codes.view(samples),
            d_codes: self.d_codes.view(samples),
        }
    }

    pub(super) fn gradient(
        &mut self,
        threads: usize,
        _: &[T],
        gradient: &mut [T],
        images: (&BinaryImages, &[u32]),
        samples: usize,
    ) {
        let SharedFrameEncoderColumns { net, frame, d_log_sigma, differences, d_mixed, .. } = self.view(samples);
        net.frame.gradient_on_images(threads, gradient, images, &frame);
        net.log_sigma.gradient(threads, gradient, Accumulate::Replace, frame.last_hidden(), d_log_sigma.data);
        if let Some(mixing) = net.mixing() {
            mixing.gradient(threads, gradient, Accumulate::Replace, differences.data, d_mixed.data);
        }
    }
}

impl<T: Real> SharedFrameEncoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], images: (&BinaryImages, &[u32])) {
        let net = self.net;
        net.frame.forward_on_images(arena, self.base, images, &mut self.frame);
        net.log_sigma.forward(arena, self.frame.last_hidden(), self.log_sigma.data, false);
        let (m, n) = (net.coordinates(), net.latent());
        let positions = self.frame.output().chunks_exact(FRAMES * m);
        let codes = self.codes.data.chunks_exact_mut(2 * n).zip(self.log_sigma.data.chunks_exact(n));
        for ((code, log_sigma), positions) in codes.zip(positions) {
            code[..m].copy_from_slice(&positions[m..]);
            code[n..].copy_from_slice(log_sigma);
        }
        if let Some(differences) = net.differences {
            self.show_differences(arena, differences);
        }
    }

    /// Writes the differences of all codes.
    fn show_differences(&mut self, arena: &[T], ScaledDifferences { scale, mixing }: ScaledDifferences) {
        let (m, n, scale) = (self.net.coordinates(), self.net.latent(), T::of(scale));
        let positions = self.frame.output().chunks_exact(FRAMES * m);
        for (differences, positions) in self.differences.data.chunks_exact_mut(m).zip(positions) {
            let (old, new) = positions.split_at(m);
            for (difference, (&new, &old)) in differences.iter_mut().zip(new.iter().zip(old)) {
                *difference = new - old;
            }
        }
        let shown = match mixing {
            None => &*self.differences.data,
            Some(mixing) => {
                mixing.forward(arena, self.differences.data, self.mixed.data, false);
                &*self.mixed.data
            }
        };
        for (code, shown) in self.codes.data.chunks_exact_mut(2 * n).zip(shown.chunks_exact(n - m)) {
            code[m..n].iter_mut().zip(shown).for_each(|(code, &shown)| *code = scale * shown);
        }
    }

    pub(super) fn backward(&mut self, arena: &[T]) {
        let net = self.net;
        let (m, n) = (net.coordinates(), net.latent());
        let d_codes = self.d_codes.data.chunks_exact(2 * n);
        for (d_log_sigma, d_code) in self.d_log_sigma.data.chunks_exact_mut(n).zip(d_codes.clone()) {
            d_log_sigma.copy_from_slice(&d_code[n..]);
        }
        net.log_sigma.backward(arena, self.d_log_sigma.data, self.d_hidden.data);
        for (d_positions, d_code) in self.frame.output_delta().chunks_exact_mut(FRAMES * m).zip(d_codes) {
            d_positions[..m].fill(T::ZERO);
            d_positions[m..].copy_from_slice(&d_code[..m]);
        }
        if let Some(differences) = net.differences {
            self.back_through_differences(arena, differences);
        }
        let d_hidden = &*self.d_hidden.data;
        net.frame.backward_with_second_head(arena, &mut self.frame, |delta| {
            delta.iter_mut().zip(d_hidden).for_each(|(delta, &d)| *delta += d);
        });
    }

    /// Adds the gradient that reaches g(new) and g(old) through the differences.
    fn back_through_differences(&mut self, arena: &[T], ScaledDifferences { scale, mixing }: ScaledDifferences) {
        let (m, n, scale) = (self.net.coordinates(), self.net.latent(), T::of(scale));
        let shown = if mixing.is_some() { &mut *self.d_mixed.data } else { &mut *self.d_differences.data };
        for (shown, d_code) in shown.chunks_exact_mut(n - m).zip(self.d_codes.data.chunks_exact(2 * n)) {
            shown.iter_mut().zip(&d_code[m..n]).for_each(|(shown, &d)| *shown = scale * d);
        }
        if let Some(mixing) = mixing {
            mixing.backward(arena, self.d_mixed.data, self.d_differences.data);
        }
        let d_positions = self.frame.output_delta().chunks_exact_mut(FRAMES * m);
        for (d_positions, d_differences) in d_positions.zip(self.d_differences.data.chunks_exact(m)) {
            let (d_old, d_new) = d_positions.split_at_mut(m);
            for ((d_old, d_new), &d) in d_old.iter_mut().zip(d_new).zip(d_differences) {
                *d_old -= d;
                *d_new += d;
            }
        }
    }

    pub(super) fn codes(&mut self) -> (&mut [T], &mut [T]) {
        (self.codes.data, self.d_codes.data)
    }
}
