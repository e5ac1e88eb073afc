//! The backward loop: gradients of a core's weights.

use pulp::{Simd, WithSimd};

use super::{Grid, Runs, run};
use crate::num::{Real, simd::arch};

/// The least number of pixels whose products are summed before the sums are stored.
const PIXELS: usize = 40;
/// The greatest number of columns of an image.
const COLUMNS: usize = 80;

/// Computes dw\[tap\]\[i\]\[o\] += Σ x\[pixel + tap\]\[i\] dy\[pixel\]\[o\] over pixels. With `runs`, over the pixels of each
/// row's run; without, over all. A row of `dy` has `dy_row` numbers.
pub(in crate::nn::conv) fn accumulate<T: Real>(
    grid: &Grid,
    runs: Option<Runs<'_>>,
    x: &[T],
    (dy, dy_row): (&[T], usize),
    dw: &mut [T],
) {
    arch().dispatch(WeightGradient { grid, runs, x, dy, dy_row, dw });
}

/// The operands of [`accumulate`].
struct WeightGradient<'a, T> {
    grid: &'a Grid,
    runs: Option<Runs<'a>>,
    x: &'a [T],
    dy: &'a [T],
    dy_row: usize,
    dw: &'a mut [T],
}

impl<T: Real> WithSimd for WeightGradient<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match T::lanes::<S>() {
            16 if self.grid.block() == 32 => self.pixels::<S, 2, 8>(simd),
            16 => self.pixels::<S, 1, 8>(simd),
            8 => self.pixels::<S, 2, 4>(simd),
            4 => self.pixels::<S, 4, 2>(simd),
            _ => self.pixels::<S, 16, 1>(simd),
        }
    }
}

impl<T: Real> WeightGradient<'_, T> {
    /// A few rows at a time: their pixels stay in the first-level cache, and sums are stored rarely.
    #[inline(always)]
    fn pixels<S: Simd, const V: usize, const I: usize>(&mut self, simd: S) {
        let g = self.grid;
        // The index of each pixel in `x` and in `dy`. With it a tile is one loop, and its sums stay in registers.
        let (mut places, mut count) = ([[0; 2]; PIXELS + COLUMNS], 0);
        for row in 0..g.rows {
            let [from, to] = run(g, self.runs, row);
            for column in from..to {
                places[count] = [row * g.in_row + column * g.in_column, row * self.dy_row + column * g.out_column];
                count += 1;
            }
            if count >= PIXELS || row + 1 == g.rows {
                self.tiles::<S, V, I>(simd, &places[..count]);
                count = 0;
            }
        }
    }

    /// All tiles for some pixels.
    #[inline(always)]
    fn tiles<S: Simd, const V: usize, const I: usize>(&mut self, simd: S, places: &[[usize; 2]]) {
        let (g, lanes) = (self.grid, T::lanes::<S>());
        for tap in 0..g.taps.len() {
            for channel in (0..g.c_out).step_by(V * lanes) {
                for input in (0..g.c_in).step_by(I) {
                    self.tile::<S, V, I>(simd, places, (tap, input, channel));
                }
            }
        }
    }

    /// One tile: one tap, `I` inputs from `input` on, `V` vectors of channels from `channel` on.
    #[inline(always)]
    fn tile<S: Simd, const V: usize, const I: usize>(
        &mut self,
        simd: S,
        places: &[[usize; 2]],
        (tap, input, channel): (usize, usize, usize),
    ) {
        let (g, lanes) = (self.grid, T::lanes::<S>());
        let vectors = g.block() / lanes;
        let dw = T::registers_mut::<S>(&mut self.dw[g.at(tap, input, channel)..]);
        let mut sums: [[T::V<S>; V]; I] = std::array::from_fn(|i| std::array::from_fn(|v| dw[i * vectors + v]));
        let (x, dy) = (&self.x[g.taps[tap] + input..], &self.dy[channel..]);
        for &[x_at, dy_at] in places {
            let (x, dy) = (&x[x_at..x_at + I], &T::registers::<S>(&dy[dy_at..dy_at + V * lanes])[..V]);
            for i in 0..I {
                let x = T::splat(simd, x[i]);
                for v in 0..V {
                    sums[i][v] = T::mul_add(simd, x, dy[v], sums[i][v]);
                }
            }
        }
        for i in 0..I {
            for v in 0..V {
                dw[i * vectors + v] = sums[i][v];
            }
        }
    }
}
