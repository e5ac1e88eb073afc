//! The two loops of a convolution, over images that lie as rows of pixels of channels (NHWC) with their border of
//! zeros in place.
//!
//! Every entry is one chain of fused multiply-adds, over taps and then channels or over pixels, so neither the size of
//! a tile nor the instruction set changes a bit.

use pulp::{Simd, WithSimd};

use crate::num::Real;

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

/// y\[pixel\]\[o\] = start\[o\] + Σ over taps and i of x\[pixel + tap\]\[i\] w\[tap\]\[i\]\[o\], then ReLU where asked; for
/// the pixels of each row's run at least, where there are `runs`, else for all.
#[allow(clippy::too_many_arguments, reason = "a product names its operands and where its result goes")]
pub(super) fn correlate<T: Real>(
    grid: &Grid,
    runs: Option<Runs<'_>>,
    w: &[T],
    start: &[T],
    relu: bool,
    x: &[T],
    y: &mut [T],
) {
    crate::num::simd::arch().dispatch(Correlate { grid, runs, w, start, relu, x, y });
}

/// The pixels from..to of every row; none where they begin behind their end.
pub(super) type Runs<'a> = &'a [[usize; 2]];

#[inline(always)]
fn run(grid: &Grid, runs: Option<Runs<'_>>, row: usize) -> [usize; 2] {
    runs.map_or([0, grid.columns], |runs| runs[row])
}

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
    /// With distances that are constants, so that a tile needs no more than one address for all of its pixels.
    #[inline(always)]
    fn pixels<S: Simd, const STEP: usize, const C_IN: usize>(&mut self, simd: S) {
        // As many sums as registers hold: V vectors of channels for each of P pixels.
        match T::count::<S>() {
            16 if self.grid.block() == 32 => self.tiles::<S, STEP, C_IN, 2, 10, 5>(simd),
            16 => self.tiles::<S, STEP, C_IN, 1, 10, 5>(simd),
            8 => self.tiles::<S, STEP, C_IN, 2, 5, 1>(simd),
            4 => self.tiles::<S, STEP, C_IN, 4, 2, 1>(simd),
            _ => self.tiles::<S, STEP, C_IN, 16, 1, 1>(simd),
        }
    }

    /// With tiles of `P` pixels, and smaller ones of `Q` at the end of a run.
    #[inline(always)]
    fn tiles<S: Simd, const STEP: usize, const C_IN: usize, const V: usize, const P: usize, const Q: usize>(
        &mut self,
        simd: S,
    ) {
        let (g, lanes) = (self.grid, T::count::<S>());
        for channel in (0..g.c_out).step_by(V * lanes) {
            for row in 0..g.rows {
                let [mut column, to] = run(g, self.runs, row);
                // At the right edge a tile begins earlier: some pixels are computed twice, to the same bits.
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
            let x: &[[T; STEP]; P] = x[tap..].as_chunks::<STEP>().0.first_chunk().expect("a tile within the image");
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
        let zero = T::splat(simd, T::ZERO);
        for p in 0..P {
            let y = &mut T::cut_mut::<S>(&mut y[p * g.out_column..])[..V];
            for v in 0..V {
                y[v] = if self.relu { T::max(simd, sums[p][v], zero) } else { sums[p][v] };
            }
        }
    }
}

/// Pixels whose products are summed before the sums are stored, and the most of a row.
const PIXELS: usize = 40;
const COLUMNS: usize = 80;

/// dw\[tap\]\[i\]\[o\] += Σ over pixels of x\[pixel + tap\]\[i\] dy\[pixel\]\[o\]; over the pixels of each row's run, where
/// there are `runs`, else over all. A row of `dy` is `dy_row` numbers long.
pub(super) fn accumulate<T: Real>(
    grid: &Grid,
    runs: Option<Runs<'_>>,
    x: &[T],
    (dy, dy_row): (&[T], usize),
    dw: &mut [T],
) {
    crate::num::simd::arch().dispatch(Accumulate { grid, runs, x, dy, dy_row, dw });
}

struct Accumulate<'a, T> {
    grid: &'a Grid,
    runs: Option<Runs<'a>>,
    x: &'a [T],
    dy: &'a [T],
    dy_row: usize,
    dw: &'a mut [T],
}

impl<T: Real> WithSimd for Accumulate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match T::count::<S>() {
            16 if self.grid.block() == 32 => self.pixels::<S, 2, 8>(simd),
            16 => self.pixels::<S, 1, 8>(simd),
            8 => self.pixels::<S, 2, 4>(simd),
            4 => self.pixels::<S, 4, 2>(simd),
            _ => self.pixels::<S, 16, 1>(simd),
        }
    }
}

impl<T: Real> Accumulate<'_, T> {
    /// A few rows at a time, so that what is read stays in the nearest cache and sums are not stored too often.
    #[inline(always)]
    fn pixels<S: Simd, const V: usize, const I: usize>(&mut self, simd: S) {
        let g = self.grid;
        // Where each pixel lies in `x` and in `dy`: a tile is one loop, whose sums stay in registers.
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

    #[inline(always)]
    fn tiles<S: Simd, const V: usize, const I: usize>(&mut self, simd: S, places: &[[usize; 2]]) {
        let (g, lanes) = (self.grid, T::count::<S>());
        for tap in 0..g.taps.len() {
            for channel in (0..g.c_out).step_by(V * lanes) {
                for input in (0..g.c_in).step_by(I) {
                    self.tile::<S, V, I>(simd, places, (tap, input, channel));
                }
            }
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const V: usize, const I: usize>(
        &mut self,
        simd: S,
        places: &[[usize; 2]],
        (tap, input, channel): (usize, usize, usize),
    ) {
        let (g, lanes) = (self.grid, T::count::<S>());
        let vectors = g.block() / lanes;
        let dw = T::cut_mut::<S>(&mut self.dw[g.at(tap, input, channel)..]);
        let mut sums: [[T::V<S>; V]; I] = std::array::from_fn(|i| std::array::from_fn(|v| dw[i * vectors + v]));
        let (x, dy) = (&self.x[g.taps[tap] + input..], &self.dy[channel..]);
        for &[x_at, dy_at] in places {
            let (x, dy) = (&x[x_at..x_at + I], &T::cut::<S>(&dy[dy_at..dy_at + V * lanes])[..V]);
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
