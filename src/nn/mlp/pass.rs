//! The buffers of a forward and backward pass.

use super::Mlp;
use crate::{nn::columns::Cut, num::Real};

/// For a number of samples, the output of every layer and the gradient with respect to it, its *delta*.
#[derive(Debug, Clone)]
pub struct Pass<T, const L: usize> {
    /// Numbers per sample in each layer's output.
    widths: [usize; L],
    out: [Vec<T>; L],
    delta: [Vec<T>; L],
}

impl<T: Real, const L: usize> Pass<T, L> {
    /// Buffers for `samples` samples, each of which is `each` columns of the network.
    pub fn new(net: &Mlp<L>, samples: usize, each: usize) -> Self {
        Self::of_widths(net.layers.map(|layer| layer.n_out * each), samples)
    }

    /// Buffers for `samples` samples, with `widths` numbers per sample in the layers' outputs.
    pub(in crate::nn) fn of_widths(widths: [usize; L], samples: usize) -> Self {
        let buffers = || widths.map(|width| vec![T::ZERO; width * samples]);
        Self { widths, out: buffers(), delta: buffers() }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> PassMut<'_, T, L> {
        let (out, delta) =
            (first_of(&mut self.out, self.widths, samples), first_of(&mut self.delta, self.widths, samples));
        PassMut { widths: self.widths, out, delta }
    }

    /// The output of the last layer.
    pub fn output(&self) -> &[T] {
        &self.out[L - 1]
    }
}

/// The first `samples` samples of each buffer.
fn first_of<T, const L: usize>(buffers: &mut [Vec<T>; L], widths: [usize; L], samples: usize) -> [&mut [T]; L] {
    let mut widths = widths.into_iter();
    buffers.each_mut().map(|buffer| &mut buffer[..widths.next().unwrap_or(0) * samples])
}

/// Some samples of a [`Pass`].
#[derive(Debug)]
pub struct PassMut<'a, T, const L: usize> {
    widths: [usize; L],
    /// The output of every layer, after its ReLU.
    pub(in crate::nn) out: [&'a mut [T]; L],
    /// The gradient with respect to every layer's output, before its ReLU.
    pub(in crate::nn) delta: [&'a mut [T]; L],
}

impl<T: Real, const L: usize> Cut for PassMut<'_, T, L> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (out, out_right) = cut_each(self.out, self.widths, samples);
        let (delta, delta_right) = cut_each(self.delta, self.widths, samples);
        (Self { widths: self.widths, out, delta }, Self { widths: self.widths, out: out_right, delta: delta_right })
    }
}

fn cut_each<'a, T, const L: usize>(
    slices: [&'a mut [T]; L],
    widths: [usize; L],
    samples: usize,
) -> ([&'a mut [T]; L], [&'a mut [T]; L]) {
    let mut right: [&'a mut [T]; L] = std::array::from_fn(|_| &mut [][..]);
    let mut at = widths.into_iter().zip(&mut right);
    let left = slices.map(|slice| {
        let (width, right) = at.next().expect("one width for every layer");
        let (a, b) = slice.split_at_mut(width * samples);
        *right = b;
        a
    });
    (left, right)
}

impl<T: Real, const L: usize> PassMut<'_, T, L> {
    /// The output of the last layer.
    pub fn output(&self) -> &[T] {
        self.out[L - 1]
    }

    /// The gradient with respect to the last layer's output, which the caller sets before a backward pass.
    pub fn output_delta(&mut self) -> &mut [T] {
        self.delta[L - 1]
    }

    /// The output of the last layer, and the gradient with respect to it.
    pub fn output_and_delta(&mut self) -> (&mut [T], &mut [T]) {
        (&mut *self.out[L - 1], &mut *self.delta[L - 1])
    }

    /// The output of the last hidden layer, after its ReLU.
    pub fn last_hidden(&self) -> &[T] {
        self.out[L - 2]
    }
}
