//! The forward loop: correlation of images with packed weights.

use pulp::{Simd, WithSimd};

use super::{Grid, Runs, run};
use crate::num::{Real, simd::arch};

/// Computes y\[pixel\]\[o\] = start\[o\] + Σ x\[pixel + tap\]\[i\] w\[tap\]\[i\]\[o\] over taps and inputs i, followed by a ReLU
/// if `relu` is set. With `runs`, at least for the pixels of each row's run; without, for all pixels.
#[allow(clippy::too_many_arguments, reason = "a product names its operands and where its result goes")]
pub(in crate::nn::conv) fn correlate<T: Real>(
    grid: &Grid,
    runs: Option<Runs<'_>>,
    w: &[T],
    start: &[T],
    relu: bool,
    x: &[T],
    y: &mut [T],
) {
    arch().dispatch(Correlate { grid, runs, w, start, relu, x, y });
}

/// The operands of [`correlate`].
struct Correlate<'a, T> {
    grid: &'a Grid,
    runs: Option<Runs<'a>>,
    w: &'a [T],
    start: &'a [T],
    relu: bool,
    x: &'a [T],
    y: &'a mut [T],
}

impl<T: Real> WithSimd for Correlate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match (self.grid.in_column, self.grid.c_in) {
            (16, 16) => self.pixels::<S, 16, 16>(simd),
            (32, 32) => self.pixels::<S, 32, 32>(simd),
            (64, 32) => self.pixels::<S, 64, 32>(simd),
            (128, 128) => self.pixels::<S, 128, 128>(simd),
            (step, c_in) => unreachable!("no kernel for {c_in} channels {step} apart"),
        }
    }
}

impl<T: Real> Correlate<'_, T> {
    /// With constant distances, so that one address serves all pixels of a tile.
    #[inline(always)]
    fn pixels<S: Simd, const STEP: usize, const C_IN: usize>(&mut self, simd: S) {
        // As many sums as there are registers: V vectors of channels for each of P pixels.
        match T::lanes::<S>() {
            16 if self.grid.block() == 32 => self.tiles::<S, STEP, C_IN, 2, 10, 5>(simd),
            16 => self.tiles::<S, STEP, C_IN, 1, 10, 5>(simd),
            8 => self.tiles::<S, STEP, C_IN, 2, 5, 1>(simd),
            4 => self.tiles::<S, STEP, C_IN, 4, 2, 1>(simd),
            _ => self.tiles::<S, STEP, C_IN, 16, 1, 1>(simd),
        }
    }

    /// With tiles of `P` pixels, and tiles of `Q` pixels at the end of a run.
    #[inline(always)]
    fn tiles<S: Simd, const STEP: usize, const C_IN: usize, const V: usize, const P: usize, const Q: usize>(
        &mut self,
        simd: S,
    ) {
        let (g, lanes) = (self.grid, T::lanes::<S>());
        for channel in (0..g.c_out).step_by(V * lanes) {
            for row in 0..g.rows {
                let [mut column, to] = run(g, self.runs, row);
                // At the right edge a tile begins earlier. Some pixels are then computed twice, to the same bits.
                while column < to {
                    if g.columns >= P && to - column > Q {
                        self.tile::<S, STEP, C_IN, V, P>(simd, channel, row, column.min(g.columns - P));
                        column += P;
                    } else if g.columns >= Q {
                        self.tile::<S, STEP, C_IN, V, Q>(simd, channel, row, column.min(g.columns - Q));
                        column += Q;
                    } else {
                        self.tile::<S, STEP, C_IN, V, 1>(simd, channel, row, column);
                        column += 1;
                    }
                }
            }
        }
    }

    /// One tile: `P` pixels of a row from `column` on, `V` vectors of channels from `channel` on.
    #[inline(always)]
    fn tile<S: Simd, const STEP: usize, const C_IN: usize, const V: usize, const P: usize>(
        &mut self,
        simd: S,
        channel: usize,
        row: usize,
        column: usize,
    ) {
        let (g, lanes) = (self.grid, T::lanes::<S>());
        // With vectors of 16 a tile is as wide as a block, so that this is a constant.
        let vectors = if lanes == 16 { V } else { g.block() / lanes };
        let first = channel % g.block() / lanes;
        let start = T::registers::<S>(&self.start[channel..]);
        let mut sums: [[T::V<S>; V]; P] = [std::array::from_fn(|v| start[v]); P];
        let w = &self.w[g.at(0, 0, channel / g.block() * g.block())..];
        let x = &self.x[row * g.in_row + column * STEP..];
        for (&tap, w) in g.taps.iter().zip(w.chunks_exact(C_IN * g.block())) {
            let x: &[[T; STEP]; P] = x[tap..].as_chunks::<STEP>().0.first_chunk().expect("a tile within the image");
            let w = &T::registers::<S>(w)[first..];
            for (i, w) in (0..C_IN).zip(w.chunks(vectors)) {
                let w = &w[..V];
                for p in 0..P {
                    let x = T::splat(simd, x[p][i]);
                    for v in 0..V {
                        sums[p][v] = T::mul_add(simd, x, w[v], sums[p][v]);
                    }
                }
            }
        }
        let y = &mut self.y[g.out_start + row * g.out_row + column * g.out_column + channel..];
        let zero = T::splat(simd, T::ZERO);
        for p in 0..P {
            let y = &mut T::registers_mut::<S>(&mut y[p * g.out_column..])[..V];
            for v in 0..V {
                y[v] = if self.relu { T::max(simd, sums[p][v], zero) } else { sums[p][v] };
            }
        }
    }
}
