//! The first convolution of binary pictures, by their lit pixels alone: a few per cent of them.

use super::{Conv, SIDE};
use crate::nn::{
    Real,
    mlp::{Layout, Linear},
    pictures::Pictures,
    vectorize,
};

/// Reach of a filter to either side.
const REACH: usize = SIDE / 2;

/// A 5x5 convolution of stride 1 with ReLU on observations, which lie frame by frame, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lit {
    /// Its parameters: W \[tap\]\[frame\]\[output\].
    pub weights: Linear,
    frames: usize,
    size: [usize; 2],
}

impl Lit {
    /// A layer on observations of so many frames of `size` rows and columns.
    pub fn new(layout: &mut Layout, name: &str, frames: usize, size: [usize; 2], c_out: usize) -> Self {
        let n_in = SIDE * SIDE * frames;
        Self { weights: layout.conv(name, n_in, c_out, n_in), frames, size }
    }

    /// Numbers of its gradient: weights, then biases.
    pub fn parameters(&self) -> usize {
        self.weights.len()
    }

    /// Every (weights' first entry, output pixel) that a lit pixel has a part in.
    fn touched(&self, pixel: usize) -> impl Iterator<Item = (usize, [usize; 2])> {
        let [rows, columns] = self.size;
        let (frame, pixel) = (pixel / (rows * columns), pixel % (rows * columns));
        let (row, column) = (pixel / columns, pixel % columns);
        let (frames, c_out) = (self.frames, self.weights.n_out);
        // Output o reads pixel o + tap - 2.
        let ys = (0..SIDE).filter(move |y| (REACH..rows + REACH).contains(&(row + 2 * REACH - y)));
        ys.flat_map(move |y| {
            let xs = (0..SIDE).filter(move |x| (REACH..columns + REACH).contains(&(column + 2 * REACH - x)));
            xs.map(move |x| (((y * SIDE + x) * frames + frame) * c_out, [row + REACH - y, column + REACH - x]))
        })
    }

    /// The outputs for a picture, into the padded input of the next layer.
    pub fn forward<T: Real>(&self, arena: &[T], pictures: &Pictures, picture: u32, next: &Conv, y: &mut [T]) {
        let (w, b, c) = (self.weights.w(arena), self.weights.b(arena), self.weights.n_out);
        let row = self.size[1] * c;
        vectorize(
            #[inline(always)]
            || {
                for r in 0..self.size[0] {
                    for y in y[next.input_at(r, 0)..][..row].chunks_exact_mut(c) {
                        y.copy_from_slice(b);
                    }
                }
                for pixel in pictures.lit(picture) {
                    for (at, [r, column]) in self.touched(pixel) {
                        for (y, &w) in y[next.input_at(r, column)..][..c].iter_mut().zip(&w[at..at + c]) {
                            *y += w;
                        }
                    }
                }
                for r in 0..self.size[0] {
                    for y in &mut y[next.input_at(r, 0)..][..row] {
                        *y = y.larger(T::nil());
                    }
                }
            },
        );
    }

    /// Adds the gradients of weights and biases for a picture. `y` is what [`Lit::forward`] put out, `d_y` the gradient
    /// with respect to it without borders, masked here.
    pub fn gradient<T: Real>(
        &self,
        (pictures, picture): (&Pictures, u32),
        next: &Conv,
        y: &[T],
        d_y: &mut [T],
        gradient: &mut [T],
    ) {
        let c = self.weights.n_out;
        let (dw, db) = gradient.split_at_mut(self.weights.n_in * c);
        let row = self.size[1] * c;
        vectorize(
            #[inline(always)]
            || {
                for (r, d_y) in d_y.chunks_exact_mut(row).enumerate() {
                    let y = &y[next.input_at(r, 0)..][..row];
                    for (d_y, y) in d_y.chunks_exact_mut(c).zip(y.chunks_exact(c)) {
                        for ((d_y, &y), db) in d_y.iter_mut().zip(y).zip(&mut *db) {
                            *d_y = if y > T::nil() { *d_y } else { T::nil() };
                            *db += *d_y;
                        }
                    }
                }
                for pixel in pictures.lit(picture) {
                    for (at, [r, column]) in self.touched(pixel) {
                        let d_y = &d_y[r * row + column * c..][..c];
                        for (dw, &d_y) in dw[at..at + c].iter_mut().zip(d_y) {
                            *dw += d_y;
                        }
                    }
                }
            },
        );
    }
}
