//! One thread's buffers for a sparse convolutional stack.

use super::{ActiveRows, SparseConvStack, SparseConvWeights, first_layer::LitRun};
use crate::{
    nn::conv::Conv,
    num::{Real, simd::vectorize},
};

/// One thread's copies of the image at hand, and its sums over a shard of the batch.
#[derive(Debug, Clone)]
pub struct ThreadBuffers<T> {
    /// The image's runs of lit pixels.
    pub(super) lit_runs: Vec<LitRun>,
    /// The active rows of the input of each layer, then those of the last layer's output.
    pub(super) active_rows: Vec<ActiveRows>,
    /// The padded input of each layer. Inactive pixels hold the blank image's.
    pub(super) inputs: Vec<Vec<T>>,
    /// The padded deltas of each layer. Inactive pixels hold leftovers of other images, which are never read.
    pub(super) deltas: Vec<Vec<T>>,
    /// The gradient with respect to a layer's output, without border and before its ReLU. Inactive pixels as in `deltas`.
    pub(super) d_out: Vec<T>,
    /// The gradient with respect to the last layer's output, at all pixels.
    d_top: Vec<T>,
    /// The sum of `d_top` over a shard.
    pub(super) sum_top: Vec<T>,
    /// For each layer, the sum over a shard of the padded deltas at active pixels.
    pub(super) sums: Vec<Vec<T>>,
    /// The same sums before the ReLU, without border.
    pub(super) sums_before_relu: Vec<Vec<T>>,
    /// The same for the first layer, by channel.
    pub(super) first_before_relu: Vec<T>,
    /// A buffer for the active rows of a phase.
    pub(super) phase_runs: Vec<[usize; 2]>,
}

impl<T: Real> ThreadBuffers<T> {
    pub(super) fn new<const L: usize>(stack: &SparseConvStack<L>) -> Self {
        let convs = &stack.convs;
        let each = |len: fn(&Conv) -> usize| convs.iter().map(|conv| vec![T::ZERO; len(conv)]).collect();
        let largest = convs.iter().map(Conv::input_len).max().unwrap_or(0);
        let rows = convs.iter().map(|conv| conv.input[0]).chain(convs.last().map(|conv| conv.core[0]));
        Self {
            // At most every other pixel begins a run.
            lit_runs: Vec::with_capacity(stack.first.pixels().div_ceil(2)),
            active_rows: rows.map(ActiveRows::new).collect(),
            inputs: each(Conv::padded_len),
            deltas: each(Conv::delta_padded_len),
            d_out: vec![T::ZERO; largest],
            d_top: vec![T::ZERO; stack.top().width()],
            sum_top: vec![T::ZERO; stack.top().width()],
            sums: each(Conv::delta_padded_len),
            sums_before_relu: each(Conv::width),
            first_before_relu: vec![T::ZERO; stack.first.weights.n_out],
            phase_runs: Vec::with_capacity(convs.first().map_or(0, |conv| conv.input[0])),
        }
    }

    /// Sets the inputs of all layers to those of the blank image.
    pub(super) fn clear(&mut self, weights: &SparseConvWeights<T>) {
        for (input, blank) in self.inputs.iter_mut().zip(&weights.blank_inputs) {
            input.copy_from_slice(blank);
        }
    }

    /// Clears the inputs and sets the sums to 0.
    pub(super) fn begin_shard(&mut self, weights: &SparseConvWeights<T>) {
        self.clear(weights);
        let sums = self.sums.iter_mut().chain(&mut self.sums_before_relu);
        sums.chain([&mut self.sum_top, &mut self.first_before_relu]).for_each(|sums| sums.fill(T::ZERO));
    }

    /// Takes an image's gradient with respect to the last layer's true output.
    pub(super) fn take_top(&mut self, top: &Conv, d_flat: &[T]) {
        top.unflatten(d_flat, &mut self.d_top);
        self.sum_top.iter_mut().zip(&self.d_top).for_each(|(sum, &d)| *sum += d);
        self.d_out[..self.d_top.len()].copy_from_slice(&self.d_top);
    }

    /// Sets the inputs at the image's active pixels back to those of the blank image.
    pub(super) fn restore(&mut self, convs: &[Conv], weights: &SparseConvWeights<T>) {
        let inputs = self.inputs.iter_mut().zip(&weights.blank_inputs);
        for ((conv, active_rows), (input, blank)) in convs.iter().zip(&self.active_rows).zip(inputs) {
            for (row, run) in active_rows.iter() {
                let at = conv.input_at(row, run.start);
                let end = at + run.len() * conv.forward.c_in;
                input[at..end].copy_from_slice(&blank[at..end]);
            }
        }
    }

    /// Copies the output of layer `l` at its active pixels into the padded input of the next layer, if there is one.
    pub(super) fn pass_on(&mut self, convs: &[Conv], l: usize, out: &[T]) {
        let Some(next) = convs.get(l + 1) else { return };
        for (row, run) in self.active_rows[l + 1].iter() {
            let (at, len) = (convs[l].output_at(row, run.start), run.len() * next.forward.c_in);
            self.inputs[l + 1][next.input_at(row, run.start)..][..len].copy_from_slice(&out[at..at + len]);
        }
    }

    /// Applies the ReLU of layer `l` to `d_out`, which gives the layer's deltas, and adds both to the sums. This is done at
    /// the active pixels of the layer's output: those of `whole` if given, else those of the image.
    pub(super) fn rectify_deltas(&mut self, conv: &Conv, l: usize, whole: Option<&ActiveRows>, out: &[T]) {
        let (deltas, sums, before_relu) = (&mut self.deltas[l], &mut self.sums[l], &mut self.sums_before_relu[l]);
        vectorize(
            #[inline(always)]
            || {
                for (row, run) in whole.unwrap_or(&self.active_rows[l + 1]).iter() {
                    let (at, len) = (conv.output_at(row, run.start), run.len() * conv.forward.c_out);
                    let padded = conv.delta_at(row, run.start);
                    let (out, d_out) = (&out[at..at + len], &self.d_out[at..at + len]);
                    let (deltas, sums) = (&mut deltas[padded..padded + len], &mut sums[padded..padded + len]);
                    let before_relu = &mut before_relu[at..at + len];
                    for i in 0..len {
                        let delta = if out[i] > T::ZERO { d_out[i] } else { T::ZERO };
                        deltas[i] = delta;
                        sums[i] += delta;
                        before_relu[i] += d_out[i];
                    }
                }
            },
        );
    }
}
