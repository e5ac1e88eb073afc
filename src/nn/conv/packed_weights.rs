//! The weights of a layer in the order in which its kernels read them.

use super::{
    Conv,
    kernels::correlate,
    layer::{Fold, Phase},
    sparse::ActiveRows,
};
use crate::num::Real;

/// A layer's packed weights: for the core, for each phase of its transpose, and the biases.
#[derive(Debug, Clone)]
pub struct PackedWeights<T> {
    pub(super) forward: Vec<T>,
    pub(super) bias: Vec<T>,
    pub(super) backward: Vec<Vec<T>>,
    /// The biases of the transpose, all zero.
    pub(super) zeros: Vec<T>,
}

impl<T: Real> PackedWeights<T> {
    /// Buffers for a layer, to be filled by [`Conv::pack`].
    pub(super) fn new(conv: &Conv) -> Self {
        Self {
            forward: vec![T::ZERO; conv.forward.weights()],
            bias: vec![T::ZERO; conv.forward.c_out],
            zeros: vec![T::ZERO; conv.forward.c_in],
            backward: conv.backward.iter().map(|phase| vec![T::ZERO; phase.grid.weights()]).collect(),
        }
    }
}

impl Conv {
    /// Packs the layer's weights and biases; once per training step.
    pub(super) fn pack<T: Real>(&self, arena: &[T], packed: &mut PackedWeights<T>) {
        let (w, b, [c_in, c_out]) = (self.weights.w(arena), self.weights.b(arena), self.channels);
        packed.forward.fill(T::ZERO);
        for &Fold { tap, core_tap, block } in &self.folds {
            for i in 0..c_in {
                let at = self.forward.at(core_tap, i, block * c_out);
                let w = &w[(tap * c_in + i) * c_out..][..c_out];
                // The outputs of a block are always neighbours in the packed weights.
                for (sum, &w) in packed.forward[at..at + c_out].iter_mut().zip(w) {
                    *sum += w;
                }
            }
        }
        for block in packed.bias.chunks_exact_mut(c_out).take(self.block[0] * self.block[1]) {
            block.copy_from_slice(b);
        }
        for (Phase { grid, taps, .. }, backward) in self.backward.iter().zip(&mut packed.backward) {
            for (tap, &core_tap) in taps.iter().enumerate() {
                for o in 0..grid.c_in {
                    for i in 0..grid.c_out {
                        backward[grid.at(tap, o, i)] = packed.forward[self.forward.at(core_tap, i, o)];
                    }
                }
            }
        }
    }

    /// Sets the gradient of the layer's parameters from the gradients of the core's weights and biases.
    pub(super) fn unfold<T: Real>(&self, d_core: &[T], d_bias: &[T], gradient: &mut [T]) {
        let [c_in, c_out] = self.channels;
        let (dw, db) = self.weights.w_b_mut(gradient);
        dw.fill(T::ZERO);
        for &Fold { tap, core_tap, block } in &self.folds {
            for i in 0..c_in {
                let at = self.forward.at(core_tap, i, block * c_out);
                for (sum, &d) in dw[(tap * c_in + i) * c_out..][..c_out].iter_mut().zip(&d_core[at..]) {
                    *sum += d;
                }
            }
        }
        db.fill(T::ZERO);
        for block in d_bias.chunks_exact(c_out).take(self.block[0] * self.block[1]) {
            for (sum, &d) in db.iter_mut().zip(block) {
                *sum += d;
            }
        }
    }

    /// Computes the gradient with respect to the input, without border, from padded deltas. With `within`, only at
    /// these active rows of the input; the vector beside them is a buffer.
    pub(super) fn d_input<T: Real>(
        &self,
        weights: &PackedWeights<T>,
        padded: &[T],
        mut within: Option<(&ActiveRows, &mut Vec<[usize; 2]>)>,
        d_input: &mut [T],
    ) {
        for (Phase { first, grid, .. }, w) in self.backward.iter().zip(&weights.backward) {
            let runs = within.as_mut().map(|(active_rows, runs)| {
                active_rows.phase(*first, self.stride, runs);
                &runs[..]
            });
            correlate(grid, runs, w, &weights.zeros, false, padded, d_input);
        }
    }
}
