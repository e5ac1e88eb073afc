//! Fully connected networks with ReLU between their layers, over one flat arena of parameters.
//!
//! A pass keeps what every layer put out and, on the way back, the gradient with respect to it ("delta"). Both are
//! per sample, so a batch may be cut into columns at will; gradients of weights are taken afterwards over all columns
//! at once, so no sum depends on how the batch was cut.

use super::mat::{self, Accumulate};
use crate::num::rng::Rng;
use crate::num::{Real, join, sampling, simd::vectorize};

/// Products below this many multiply-adds are not worth a second thread.
const WORTH_A_THREAD: usize = 1 << 22;

/// Where one affine layer `y = W x + b` lies in the arena: W \[n_out, n_in\] column-major, then b.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear {
    /// Width of the input.
    pub n_in: usize,
    /// Width of the output.
    pub n_out: usize,
    /// Its first random weights lie within 1/sqrt of this.
    pub fan_in: usize,
    /// Offset of the first weight.
    pub at: usize,
}

/// Hands out places in an arena and remembers their names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Layout {
    /// Numbers handed out so far.
    pub len: usize,
    /// Layers by name, in arena order.
    pub layers: Vec<(String, Linear)>,
}

impl Layout {
    /// A place for an affine layer.
    pub fn linear(&mut self, name: impl Into<String>, n_in: usize, n_out: usize) -> Linear {
        self.conv(name, n_in, n_out, n_in)
    }

    /// The same with another bound of its first random weights, as transposed convolutions have it.
    pub fn conv(&mut self, name: impl Into<String>, n_in: usize, n_out: usize, fan_in: usize) -> Linear {
        let linear = Linear { n_in, n_out, fan_in, at: self.len };
        self.len += linear.len();
        self.layers.push((name.into(), linear));
        linear
    }

    /// Places for a network of `L` layers, named `name.0`, `name.1`, ….
    pub fn mlp<const L: usize>(&mut self, name: &str, n_in: usize, widths: [usize; L]) -> Mlp<L> {
        let mut n_in = n_in;
        Mlp {
            layers: std::array::from_fn(|i| {
                let linear = self.linear(format!("{name}.{i}"), n_in, widths[i]);
                n_in = widths[i];
                linear
            }),
        }
    }

    /// Parameters drawn from U(-1/sqrt(fan_in), 1/sqrt(fan_in)), weights and biases alike.
    pub fn initialize<T: Real>(&self, rng: &mut Rng) -> Vec<T> {
        let mut arena = vec![T::ZERO; self.len];
        for (_, linear) in &self.layers {
            let bound = (1.0 / linear.fan_in as f64).sqrt() as f32;
            for p in &mut arena[linear.at..linear.at + linear.len()] {
                *p = T::of(f64::from(sampling::uniform(rng, -bound, bound)));
            }
        }
        arena
    }
}

impl Linear {
    /// Numbers it takes in the arena.
    pub fn len(&self) -> usize {
        (self.n_in + 1) * self.n_out
    }

    /// True for a layer without parameters.
    pub fn is_empty(&self) -> bool {
        self.n_out == 0
    }

    /// Its weights.
    pub fn w<'a, T>(&self, arena: &'a [T]) -> &'a [T] {
        &arena[self.at..self.at + self.n_in * self.n_out]
    }

    /// Its biases.
    pub fn b<'a, T>(&self, arena: &'a [T]) -> &'a [T] {
        &arena[self.at + self.n_in * self.n_out..self.at + self.len()]
    }

    /// Its weights and biases, to change.
    pub fn w_b_mut<'a, T>(&self, arena: &'a mut [T]) -> (&'a mut [T], &'a mut [T]) {
        arena[self.at..self.at + self.len()].split_at_mut(self.n_in * self.n_out)
    }

    /// y = W x + b for every column, then ReLU where asked.
    pub fn forward<T: Real>(&self, arena: &[T], x: &[T], y: &mut [T], relu: bool) {
        let columns = y.len() / self.n_out;
        mat::product(y, Accumulate::Replace, self.w(arena), x, (self.n_out, self.n_in, columns));
        add_bias(y, self.b(arena), relu);
    }

    /// dx = Wᵀ dy for every column.
    pub fn backward<T: Real>(&self, arena: &[T], dy: &[T], dx: &mut [T]) {
        let columns = dy.len() / self.n_out;
        mat::product_transposed(dx, Accumulate::Replace, self.w(arena), dy, (self.n_out, self.n_in, columns));
    }

    /// Adds or sets dW = Σ dy xᵀ and db = Σ dy.
    pub fn gradient<T: Real>(&self, threads: usize, gradient: &mut [T], accumulate: Accumulate, x: &[T], dy: &[T]) {
        let (dw, db) = self.w_b_mut(gradient);
        self.weight_gradient(threads, dw, accumulate, x, dy, 0);
        sum_columns(db, accumulate, dy);
    }

    /// Adds or sets dW = Σ dy xᵀ, from column `first` of W.
    pub fn weight_gradient<T: Real>(
        &self,
        threads: usize,
        dw: &mut [T],
        accumulate: Accumulate,
        x: &[T],
        dy: &[T],
        first: usize,
    ) {
        let columns = dw.len() / self.n_out;
        if threads > 1 && columns > 1 && columns * dy.len() > WORTH_A_THREAD {
            let (left, right) = dw.split_at_mut(columns / 2 * self.n_out);
            join(
                threads,
                || self.weight_gradient(threads / 2, left, accumulate, x, dy, first),
                || self.weight_gradient(threads - threads / 2, right, accumulate, x, dy, first + columns / 2),
            );
        } else {
            mat::outer(dw, accumulate, dy, x, self.n_out, self.n_in, first);
        }
    }
}

/// y = max(y + b, 0) for every column, or without the maximum.
pub fn add_bias<T: Real>(y: &mut [T], b: &[T], relu: bool) {
    vectorize(
        #[inline(always)]
        || {
            for y in y.chunks_exact_mut(b.len()) {
                if relu {
                    for (y, &b) in y.iter_mut().zip(b) {
                        *y = (*y + b).larger(T::ZERO);
                    }
                } else {
                    for (y, &b) in y.iter_mut().zip(b) {
                        *y += b;
                    }
                }
            }
        },
    );
}

/// x = max(x, 0).
pub fn rectify<T: Real>(x: &mut [T]) {
    vectorize(
        #[inline(always)]
        || {
            for x in x {
                *x = x.larger(T::ZERO);
            }
        },
    );
}

/// Zeroes deltas where the ReLU put out nothing.
pub fn mask<T: Real>(delta: &mut [T], out: &[T]) {
    vectorize(
        #[inline(always)]
        || {
            for (delta, &out) in delta.iter_mut().zip(out) {
                *delta = if out > T::ZERO { *delta } else { T::ZERO };
            }
        },
    );
}

/// Adds or sets the sum over columns.
pub fn sum_columns<T: Real>(sum: &mut [T], accumulate: Accumulate, columns: &[T]) {
    if accumulate == Accumulate::Replace {
        sum.fill(T::ZERO);
    }
    vectorize(
        #[inline(always)]
        || {
            for column in columns.chunks_exact(sum.len()) {
                for (sum, &x) in sum.iter_mut().zip(column) {
                    *sum += x;
                }
            }
        },
    );
}

/// A network of `L` affine layers with ReLU between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mlp<const L: usize> {
    /// Its layers.
    pub layers: [Linear; L],
}

/// What every layer put out and the gradient with respect to it, for a number of samples.
#[derive(Debug, Clone)]
pub struct Pass<T, const L: usize> {
    /// Numbers each layer puts out for one sample.
    widths: [usize; L],
    out: [Vec<T>; L],
    delta: [Vec<T>; L],
}

impl<T: Real, const L: usize> Pass<T, L> {
    /// Room for `samples` samples with `each` columns of the network.
    pub fn new(net: &Mlp<L>, samples: usize, each: usize) -> Self {
        Self::of_widths(net.layers.map(|layer| layer.n_out * each), samples)
    }

    /// Room for `samples` samples for which each layer puts out so many numbers.
    pub fn of_widths(widths: [usize; L], samples: usize) -> Self {
        let room = || widths.map(|width| vec![T::ZERO; width * samples]);
        Self { widths, out: room(), delta: room() }
    }

    /// The first `samples` samples.
    pub fn view(&mut self, samples: usize) -> PassMut<'_, T, L> {
        let widths = self.widths;
        let mut first = widths.into_iter();
        let out = self.out.each_mut().map(|x| &mut x[..first.next().unwrap_or(0) * samples]);
        let mut first = widths.into_iter();
        let delta = self.delta.each_mut().map(|x| &mut x[..first.next().unwrap_or(0) * samples]);
        PassMut { widths, out, delta }
    }

    /// What the last layer put out.
    pub fn output(&self) -> &[T] {
        &self.out[L - 1]
    }
}

/// Some samples of a [`Pass`].
#[derive(Debug)]
pub struct PassMut<'a, T, const L: usize> {
    widths: [usize; L],
    /// What every layer put out, after its ReLU.
    pub out: [&'a mut [T]; L],
    /// The gradient with respect to it, before the ReLU.
    pub delta: [&'a mut [T]; L],
}

fn split_each<'a, T, const L: usize>(
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

impl<'a, T: Real, const L: usize> PassMut<'a, T, L> {
    /// Its first `samples` samples and the rest.
    pub fn split_at(self, samples: usize) -> (Self, Self) {
        let (out, out_right) = split_each(self.out, self.widths, samples);
        let (delta, delta_right) = split_each(self.delta, self.widths, samples);
        (Self { widths: self.widths, out, delta }, Self { widths: self.widths, out: out_right, delta: delta_right })
    }

    /// A shorter borrow of the same columns.
    pub fn reborrow(&mut self) -> PassMut<'_, T, L> {
        PassMut {
            widths: self.widths,
            out: self.out.each_mut().map(|x| &mut **x),
            delta: self.delta.each_mut().map(|x| &mut **x),
        }
    }

    /// What the last layer put out.
    pub fn output(&self) -> &[T] {
        self.out[L - 1]
    }

    /// The last layer's output, and the gradient with respect to it.
    pub fn output_and_delta(&mut self) -> (&mut [T], &mut [T]) {
        (&mut *self.out[L - 1], &mut *self.delta[L - 1])
    }

    /// The gradient with respect to what the last layer put out, to fill in.
    pub fn output_delta(&mut self) -> &mut [T] {
        self.delta[L - 1]
    }
}

impl<const L: usize> Mlp<L> {
    /// All layers on dense columns `x`.
    pub fn forward<T: Real>(&self, arena: &[T], x: &[T], pass: &mut PassMut<'_, T, L>) {
        self.layers[0].forward(arena, x, pass.out[0], L > 1);
        self.forward_from_second(arena, pass);
    }

    /// The layers after the first, whose output is there already.
    pub fn forward_from_second<T: Real>(&self, arena: &[T], pass: &mut PassMut<'_, T, L>) {
        for i in 1..L {
            let (before, after) = pass.out.split_at_mut(i);
            self.layers[i].forward(arena, before[i - 1], after[0], i + 1 < L);
        }
    }

    /// Deltas of all layers from that of the last; then, where asked, the gradient with respect to the input.
    pub fn backward<T: Real>(&self, arena: &[T], pass: &mut PassMut<'_, T, L>, input_delta: Option<&mut [T]>) {
        for i in (1..L).rev() {
            let (before, after) = pass.delta.split_at_mut(i);
            self.layers[i].backward(arena, after[0], before[i - 1]);
            mask(before[i - 1], pass.out[i - 1]);
        }
        if let Some(dx) = input_delta {
            self.layers[0].backward(arena, pass.delta[0], dx);
        }
    }

    /// Gradients of all weights; `x` is the dense input.
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        accumulate: Accumulate,
        x: &[T],
        pass: &PassMut<'_, T, L>,
    ) {
        self.layers[0].gradient(threads, gradient, accumulate, x, pass.delta[0]);
        self.gradient_from_second(threads, gradient, accumulate, pass);
    }

    /// Gradients of the weights after the first layer.
    pub fn gradient_from_second<T: Real>(
        &self,
        threads: usize,
        gradient: &mut [T],
        accumulate: Accumulate,
        pass: &PassMut<'_, T, L>,
    ) {
        for i in 1..L {
            self.layers[i].gradient(threads, gradient, accumulate, pass.out[i - 1], pass.delta[i]);
        }
    }

    /// The directional derivative of the network along `tangent`, at the columns of `at` (forward mode).
    pub fn tangent<T: Real>(&self, arena: &[T], at: &PassMut<'_, T, L>, tangent: &[T], pass: &mut PassMut<'_, T, L>) {
        for i in 0..L {
            let (before, after) = pass.out.split_at_mut(i);
            let x = if i == 0 { tangent } else { &*before[i - 1] };
            let (layer, columns) = (self.layers[i], after[0].len() / self.layers[i].n_out);
            mat::product(after[0], Accumulate::Replace, layer.w(arena), x, (layer.n_out, layer.n_in, columns));
            if i + 1 < L {
                mask(after[0], at.out[i]);
            }
        }
    }

    /// Deltas of the directional derivative's layers from that of its last.
    pub fn tangent_backward<T: Real>(&self, arena: &[T], at: &PassMut<'_, T, L>, pass: &mut PassMut<'_, T, L>) {
        for i in (1..L).rev() {
            let (before, after) = pass.delta.split_at_mut(i);
            self.layers[i].backward(arena, after[0], before[i - 1]);
            mask(before[i - 1], at.out[i - 1]);
        }
    }

    /// Adds the gradients of the weights through the directional derivative, in which biases have no part.
    pub fn add_tangent_gradient<T: Real>(&self, gradient: &mut [T], tangent: &[T], pass: &PassMut<'_, T, L>) {
        for i in 0..L {
            let (dw, _) = self.layers[i].w_b_mut(gradient);
            let x = if i == 0 { tangent } else { &*pass.out[i - 1] };
            self.layers[i].weight_gradient(1, dw, Accumulate::Add, x, pass.delta[i], 0);
        }
    }
}
