//! The decoder that predicts each frame by the same network.

use crate::{
    lce::shared_frames::FRAMES,
    nn::{
        columns::{Block, BlockMut, cut_together},
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass, PassMut},
    },
    num::Real,
};

/// Where the layers are in the arena. The frames of a code \[q; v\] are decoded from q (the newest) and from
/// q - v/scale (the older).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedFrameDecoder {
    frame: Mlp<3>,
    scale: f64,
}

impl SharedFrameDecoder {
    /// Lays out the decoder for codes of `coordinates` positions and as many differences, times `scale`. A frame has
    /// `logits` logits.
    pub(super) fn new(
        layout: &mut Layout,
        coordinates: usize,
        scale: f64,
        [first, second]: [usize; 2],
        logits: usize,
    ) -> Self {
        Self { frame: layout.mlp("decoder", coordinates, [first, second, logits]), scale }
    }

    /// Its first and its last layer in the arena.
    pub(super) fn first_and_last(&self) -> (Linear, Linear) {
        (self.frame.layers[0], self.frame.layers[2])
    }
}

/// Buffers for a batch. The frames of a code are columns of the network, the older one first.
#[derive(Debug, Clone)]
pub(in crate::lce) struct SharedFrameDecoderPass<T> {
    net: SharedFrameDecoder,
    positions: Block<T>,
    d_positions: Block<T>,
    frame: Pass<T, 3>,
}

cut_together! {
    /// Some samples of a [`SharedFrameDecoderPass`].
    #[derive(Debug)]
    pub(in crate::lce) struct SharedFrameDecoderColumns<'a, T> {
        net: &'a SharedFrameDecoder,
        positions: BlockMut<'a, T>,
        d_positions: BlockMut<'a, T>,
        frame: PassMut<'a, T, 3>,
    }
}

impl<T: Real> SharedFrameDecoderPass<T> {
    pub(super) fn new(net: &SharedFrameDecoder, samples: usize, each: usize) -> Self {
        let m = net.frame.layers[0].n_in;
        let positions = || Block::new(FRAMES * m * each, samples);
        let frame = Pass::new(&net.frame, samples, FRAMES * each);
        Self { net: *net, positions: positions(), d_positions: positions(), frame }
    }

    pub(super) fn view(&mut self, samples: usize) -> SharedFrameDecoderColumns<'_, T> {
        SharedFrameDecoderColumns {
            net: &self.net,
            positions: self.positions.view(samples),
            d_positions: self.d_positions.view(samples),
            frame: self.frame.view(samples),
        }
    }

    pub(super) fn gradient(&mut self, threads: usize, gradient: &mut [T], _: &[T], samples: usize) {
        let SharedFrameDecoderColumns { net, positions, frame, .. } = self.view(samples);
        net.frame.gradient(threads, gradient, Accumulate::Replace, positions.data, &frame);
    }
}

impl<T: Real> SharedFrameDecoderColumns<'_, T> {
    pub(super) fn forward(&mut self, arena: &[T], z: &[T]) {
        let (m, scale) = (self.net.frame.layers[0].n_in, T::of(self.net.scale));
        for (positions, z) in self.positions.data.chunks_exact_mut(FRAMES * m).zip(z.chunks_exact(2 * m)) {
            let ((old, new), (q, v)) = (positions.split_at_mut(m), z.split_at(m));
            new.copy_from_slice(q);
            old.iter_mut().zip(q.iter().zip(v)).for_each(|(old, (&q, &v))| *old = q - v / scale);
        }
        self.net.frame.forward(arena, self.positions.data, &mut self.frame);
    }

    pub(super) fn backward(&mut self, arena: &[T], d_z: &mut [T]) {
        let (m, scale) = (self.net.frame.layers[0].n_in, T::of(self.net.scale));
        self.net.frame.backward(arena, &mut self.frame, Some(self.d_positions.data));
        for (d_positions, d_z) in self.d_positions.data.chunks_exact(FRAMES * m).zip(d_z.chunks_exact_mut(2 * m)) {
            let ((d_old, d_new), (d_q, d_v)) = (d_positions.split_at(m), d_z.split_at_mut(m));
            for ((d_q, d_v), (&d_old, &d_new)) in d_q.iter_mut().zip(d_v).zip(d_old.iter().zip(d_new)) {
                *d_q = d_old + d_new;
                *d_v = -d_old / scale;
            }
        }
    }

    pub(super) fn logits(&mut self) -> (&mut [T], &mut [T]) {
        self.frame.output_and_delta()
    }
}
