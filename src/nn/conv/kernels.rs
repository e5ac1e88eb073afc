//! The two loops of a convolution, over pictures that lie as rows of pixels of channels (NHWC) with their border of
//! zeros in place.
//!
//! Every entry is one chain of fused multiply-adds, over taps and then channels or over pixels, so neither the size of
//! a tile nor the instruction set changes a bit.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::nn::Real;

/// Where a correlation reads and writes; everything is counted in entries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Grid {
    /// Rows and columns of outputs.
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// From one row or column of outputs to the next, in the input.
    pub(super) in_row: usize,
    pub(super) in_column: usize,
    /// The same in the output, and where it begins.
    pub(super) out_row: usize,
    pub(super) out_column: usize,
    pub(super) out_start: usize,
    /// Where each tap reads, from an output's place in the input.
    pub(super) taps: Vec<usize>,
    /// Channels read and written, multiples of 16.
    pub(super) c_in: usize,
    pub(super) c_out: usize,
}

impl Grid {
    /// Channels that one tile writes: weights of that many lie side by side.
    fn block(&self) -> usize {
        block(self.c_out)
    }

    /// Numbers in its packed weights.
    pub(super) fn weights(&self) -> usize {
        self.taps.len() * self.c_in * self.c_out
    }

    /// Where the weight of a tap lies in the packed weights \[block of outputs\]\[tap\]\[input\]\[output in block\].
    pub(super) fn at(&self, tap: usize, input: usize, output: usize) -> usize {
        let b = self.block();
        ((output / b * self.taps.len() + tap) * self.c_in + input) * b + output % b
    }
}

fn block(c_out: usize) -> usize {
    if c_out.is_multiple_of(32) { 32 } else { 16 }
}

/// y\[pixel\]\[o\] = start\[o\] + Σ over taps and i of x\[pixel + tap\]\[i\] w\[tap\]\[i\]\[o\], then ReLU where asked.
pub(super) fn correlate<T: Real>(grid: &Grid, w: &[T], start: &[T], relu: bool, x: &[T], y: &mut [T]) {
    crate::nn::arch().dispatch(Correlate { grid, w, start, relu, x, y });
}

struct Correlate<'a, T> {
    grid: &'a Grid,
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
    /// With distances that are constants, so that a tile needs no more than one address for all of its pixels.
    #[inline(always)]
    fn pixels<S: Simd, const STEP: usize, const C_IN: usize>(&mut self, simd: S) {
        // As many sums as registers hold: V vectors of channels for each of P pixels.
        match T::count::<S>() {
            16 if self.grid.block() == 32 => self.tiles::<S, STEP, C_IN, 2, 10>(simd),
            16 => self.tiles::<S, STEP, C_IN, 1, 10>(simd),
            8 => self.tiles::<S, STEP, C_IN, 2, 5>(simd),
            4 => self.tiles::<S, STEP, C_IN, 4, 2>(simd),
            _ => self.tiles::<S, STEP, C_IN, 16, 1>(simd),
        }
    }

    #[inline(always)]
    fn tiles<S: Simd, const STEP: usize, const C_IN: usize, const V: usize, const P: usize>(&mut self, simd: S) {
        let (g, lanes) = (self.grid, T::count::<S>());
        for channel in (0..g.c_out).step_by(V * lanes) {
            for row in 0..g.rows {
                let mut column = 0;
                while column + P <= g.columns {
                    self.tile::<S, STEP, C_IN, V, P>(simd, channel, row, column);
                    column += P;
                }
                while column < g.columns {
                    self.tile::<S, STEP, C_IN, V, 1>(simd, channel, row, column);
                    column += 1;
                }
            }
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const STEP: usize, const C_IN: usize, const V: usize, const P: usize>(
        &mut self,
        simd: S,
        channel: usize,
        row: usize,
        column: usize,
    ) {
        let (g, lanes) = (self.grid, T::count::<S>());
        // The same where a tile is as wide as a block, which vectors of 16 make it.
        let vectors = if lanes == 16 { V } else { g.block() / lanes };
        let first = channel % g.block() / lanes;
        let start = T::cut::<S>(&self.start[channel..]);
        let mut sums: [[T::V<S>; V]; P] = [std::array::from_fn(|v| start[v]); P];
        let w = &self.w[g.at(0, 0, channel / g.block() * g.block())..];
        let x = &self.x[row * g.in_row + column * STEP..];
        for (&tap, w) in g.taps.iter().zip(w.chunks_exact(C_IN * g.block())) {
            let x: &[[T; STEP]; P] = x[tap..].as_chunks::<STEP>().0.first_chunk().expect("a tile within the picture");
            let w = &T::cut::<S>(w)[first..];
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
        let zero = T::splat(simd, T::nil());
        for p in 0..P {
            let y = &mut T::cut_mut::<S>(&mut y[p * g.out_column..])[..V];
            for v in 0..V {
                y[v] = if self.relu { T::max(simd, sums[p][v], zero) } else { sums[p][v] };
            }
        }
    }
}

/// Pixels whose products are summed before the sums are stored.
const PIXELS: usize = 40;

/// dw\[tap\]\[i\]\[o\] += Σ over pixels of x\[pixel + tap\]\[i\] dy\[pixel\]\[o\].
pub(super) fn accumulate<T: Real>(grid: &Grid, x: &[T], dy: &[T], dw: &mut [T]) {
    crate::nn::arch().dispatch(Accumulate { grid, x, dy, dw });
}

struct Accumulate<'a, T> {
    grid: &'a Grid,
    x: &'a [T],
    dy: &'a [T],
    dw: &'a mut [T],
}

impl<T: Real> WithSimd for Accumulate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match (self.grid.in_column, self.grid.out_column) {
            (16, 32) => self.pixels::<S, 16, 32>(simd),
            (32, 128) => self.pixels::<S, 32, 128>(simd),
            (64, 16) => self.pixels::<S, 64, 16>(simd),
            (64, 32) => self.pixels::<S, 64, 32>(simd),
            (step, c_out) => unreachable!("no kernel for inputs {step} and outputs {c_out} apart"),
        }
    }
}

impl<T: Real> Accumulate<'_, T> {
    #[inline(always)]
    fn pixels<S: Simd, const STEP: usize, const C_OUT: usize>(&mut self, simd: S) {
        match T::count::<S>() {
            16 if self.grid.block() == 32 => self.rows::<S, STEP, C_OUT, 2, 8>(simd),
            16 => self.rows::<S, STEP, C_OUT, 1, 8>(simd),
            8 => self.rows::<S, STEP, C_OUT, 2, 4>(simd),
            4 => self.rows::<S, STEP, C_OUT, 4, 2>(simd),
            _ => self.rows::<S, STEP, C_OUT, 16, 1>(simd),
        }
    }

    /// A few rows at a time, so that what is read stays in the nearest cache and sums are not stored too often.
    #[inline(always)]
    fn rows<S: Simd, const STEP: usize, const C_OUT: usize, const V: usize, const I: usize>(&mut self, simd: S) {
        let (g, lanes) = (self.grid, T::count::<S>());
        let at_once = (PIXELS / g.columns).max(1);
        for row in (0..g.rows).step_by(at_once) {
            let rows = row..(row + at_once).min(g.rows);
            for tap in 0..g.taps.len() {
                for channel in (0..g.c_out).step_by(V * lanes) {
                    for input in (0..g.c_in).step_by(I) {
                        self.tile::<S, STEP, C_OUT, V, I>(simd, rows.clone(), tap, channel, input);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const STEP: usize, const C_OUT: usize, const V: usize, const I: usize>(
        &mut self,
        simd: S,
        rows: Range<usize>,
        tap: usize,
        channel: usize,
        input: usize,
    ) {
        let (g, lanes) = (self.grid, T::count::<S>());
        let vectors = g.block() / lanes;
        let dw = T::cut_mut::<S>(&mut self.dw[g.at(tap, input, channel)..]);
        let mut sums: [[T::V<S>; V]; I] = std::array::from_fn(|i| std::array::from_fn(|v| dw[i * vectors + v]));
        for row in rows {
            let x = &self.x[row * g.in_row + g.taps[tap] + input..];
            // Chunks begin at the tile's own channels; what is left after the last pixel's may be short of a chunk.
            let dy = self.dy[row * g.out_row..][..g.columns * C_OUT].as_chunks::<C_OUT>().0;
            let x = x[..(g.columns - 1) * STEP + I].chunks(STEP);
            for (x, dy) in x.zip(dy) {
                let (x, dy) = (&x[..I], &T::cut::<S>(&dy[channel..channel + V * lanes])[..V]);
                for i in 0..I {
                    let x = T::splat(simd, x[i]);
                    for v in 0..V {
                        sums[i][v] = T::mul_add(simd, x, dy[v], sums[i][v]);
                    }
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
