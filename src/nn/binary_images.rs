//! Binary images as their few differences from a reference image, and first layers that use it.
//!
//! BinaryImages of a task share their background, and an agent covers a few pixels of it: `W x` is then `W x_reference` plus
//! a handful of columns of W. This is exact, not an approximation, and an order of magnitude less work. Networks may also
//! read an image patch by patch: how much of each is lit.

use pulp::{Simd, WithSimd};

use super::mlp::Linear;
use crate::num::rng::Rng;
use crate::num::{
    Real, join, sampling,
    simd::{arch, vectorize},
};

/// PooledPatches of pixels that networks read as one number, how much of it is lit, and that they give one probability.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PooledPatches {
    /// Columns of an image, a multiple of `side`.
    pub columns: usize,
    /// Rows and columns of a patch, at most 15.
    pub side: usize,
}

impl PooledPatches {
    /// Pixels of a patch.
    pub fn area(self) -> usize {
        self.side * self.side
    }

    /// The patch that a pixel lies in; they are counted row by row, as pixels are.
    pub fn around(self, pixel: usize) -> usize {
        let (row, column) = (pixel / self.columns, pixel % self.columns);
        row / self.side * (self.columns / self.side) + column / self.side
    }
}

/// BinaryImages of one size with values 0 and 1.
#[derive(Debug, Clone, PartialEq)]
pub struct BinaryImages {
    pixels: usize,
    patches: Option<PooledPatches>,
    /// Of every entry that networks read, a pixel or a patch.
    reference: Vec<bool>,
    reference_lit: Vec<u32>,
    starts: Vec<u32>,
    /// An entry, and in the lowest [`LEVEL_BITS`] bits what it is instead of what the reference has: of a pixel
    /// [`LIT`] or [`DARK`], of a patch how many of its pixels are lit. With [`UNREAD`] networks do not read it.
    changes: Vec<u32>,
    /// How much louder than it is a change is read.
    dropout_scale: f64,
}

const LEVEL_BITS: u32 = 8;
const LEVELS: usize = 1 << LEVEL_BITS;
const LIT: u32 = 0;
const DARK: u32 = 1;
const UNREAD: u32 = 1 << 31;

fn entry(change: u32) -> usize {
    ((change & !UNREAD) >> LEVEL_BITS) as usize
}

fn level(change: u32) -> usize {
    change as usize % LEVELS
}

impl BinaryImages {
    /// No images yet, to be compared with `reference`.
    pub fn new(reference: &[u8]) -> Self {
        let reference_lit = (0_u32..).zip(reference).filter(|&(_, &p)| p != 0).map(|(pixel, _)| pixel).collect();
        let reference: Vec<bool> = reference.iter().map(|&p| p != 0).collect();
        let pixels = reference.len();
        Self {
            pixels,
            patches: None,
            reference,
            reference_lit,
            starts: vec![0],
            changes: Vec::new(),
            dropout_scale: 1.0,
        }
    }

    /// No images yet, of so many pixels, to be read in patches.
    pub fn pooled(pixels: usize, patches: PooledPatches) -> Self {
        let reference = vec![false; pixels / patches.area()];
        let (reference_lit, starts, changes) = (Vec::new(), vec![0], Vec::new());
        Self { pixels, patches: Some(patches), reference, reference_lit, starts, changes, dropout_scale: 1.0 }
    }

    /// Adds images that lie one after the other; any non-zero byte is lit.
    pub fn extend(&mut self, frames: &[u8]) {
        let mut counts = vec![0; if self.patches.is_some() { self.reference.len() } else { 0 }];
        for frame in frames.chunks_exact(self.pixels) {
            if let Some(patches) = self.patches {
                counts.fill(0);
                let lit = frame.iter().enumerate().filter(|&(_, &value)| value != 0);
                lit.for_each(|(pixel, _)| counts[patches.around(pixel)] += 1);
                let seen = (0..).zip(&counts).filter(|&(_, &count)| count > 0);
                self.changes.extend(seen.map(|(patch, &count): (u32, &u32)| patch << LEVEL_BITS | count));
            } else {
                for (pixel, (&value, &reference)) in frame.iter().zip(&self.reference).enumerate() {
                    if (value != 0) != reference {
                        self.changes.push((pixel as u32) << LEVEL_BITS | if reference { DARK } else { LIT });
                    }
                }
            }
            self.starts.push(self.changes.len() as u32);
        }
    }

    /// The images `which` of these for one step of training: networks read every lit patch with probability 1 - `share`
    /// only, and louder by that, so that means stay (dropout). What is to be decoded stays whole.
    ///
    /// # Panics
    ///
    /// If images are read by pixels.
    pub fn with_dropout(&self, which: &[u32], share: f64, rng: &mut Rng) -> Self {
        assert!(self.patches.is_some(), "only patches are thinned");
        let (mut starts, mut changes) = (vec![0], Vec::new());
        for &image in which {
            let unread = |&change: &u32| {
                let is_unread = f64::from(sampling::uniform(rng, 0.0, 1.0)) < share;
                if is_unread { change | UNREAD } else { change }
            };
            changes.extend(self.changes(image).iter().map(unread));
            starts.push(changes.len() as u32);
        }
        let (reference, reference_lit) = (self.reference.clone(), self.reference_lit.clone());
        let (pixels, patches, dropout_scale) = (self.pixels, self.patches, 1.0 / (1.0 - share));
        Self { pixels, patches, reference, reference_lit, starts, changes, dropout_scale }
    }

    /// Pixels that an entry stands for.
    pub fn area(&self) -> usize {
        self.patches.map_or(1, PooledPatches::area)
    }

    /// What every level of a change adds to an entry.
    fn factors<T: Real>(&self) -> Factors<T> {
        let mut factors = [T::ZERO; LEVELS];
        match self.patches {
            None => (factors[LIT as usize], factors[DARK as usize]) = (T::ONE, -T::ONE),
            Some(patches) => {
                let area = patches.area();
                for (count, factor) in factors[..=area].iter_mut().enumerate() {
                    *factor = T::of(count as f64 / area as f64 * self.dropout_scale);
                }
            }
        }
        Factors(factors)
    }

    /// How many images.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// True without images.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Its entries of `changes`, by rising entry.
    fn changes(&self, image: u32) -> &[u32] {
        &self.changes[self.starts[image as usize] as usize..self.starts[image as usize + 1] as usize]
    }

    /// The same for some of the entries.
    fn changes_at(&self, image: u32, entries: std::ops::Range<usize>) -> &[u32] {
        let changes = self.changes(image);
        let before = |at: usize| changes.partition_point(|&change| entry(change) < at);
        &changes[before(entries.start)..before(entries.end)]
    }

    /// The entries of an image in which pixels are lit, and how many.
    pub fn lit(&self, image: u32) -> impl Iterator<Item = (usize, usize)> + '_ {
        let in_squares = self.patches.is_some();
        let darkens = move |change: u32| !in_squares && level(change) == DARK as usize;
        let darkened = move |pixel| self.changes(image).iter().any(|&c| entry(c) == pixel && darkens(c));
        let kept = self.reference_lit().filter(move |&pixel| !darkened(pixel)).map(|pixel| (pixel, 1));
        let changed = self.changes(image).iter().filter(move |&&change| !darkens(change));
        kept.chain(changed.map(move |&change| (entry(change), if in_squares { level(change) } else { 1 })))
    }

    fn reference_lit(&self) -> impl Iterator<Item = usize> + '_ {
        self.reference_lit.iter().map(|&pixel| pixel as usize)
    }

    /// W x_reference + b, which every column of [`BinaryImages::affine`] starts from.
    pub fn base<T: Real>(&self, layer: &Linear, arena: &[T], base: &mut [T]) {
        base.copy_from_slice(layer.b(arena));
        for pixel in self.reference_lit() {
            add(base, column(layer, layer.w(arena), pixel), T::ONE);
        }
    }

    /// y = W x + b for the images `which`, then ReLU where asked. A column of `y` is `stride` long, and the layer's
    /// outputs begin at `offset` in it.
    #[allow(clippy::too_many_arguments, reason = "a matrix product names its operands and where its result goes")]
    pub fn affine<T: Real>(
        &self,
        layer: &Linear,
        arena: &[T],
        base: &[T],
        which: &[u32],
        y: &mut [T],
        place: OutputRows,
        relu: bool,
    ) {
        arch().dispatch(Affine { images: self, layer, w: layer.w(arena), base, which, y, place, relu });
    }

    /// Sets dW = Σ dy xᵀ and db = Σ dy over the images `which`; deltas lie as outputs do in [`BinaryImages::affine`].
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        gradient: &mut [T],
        which: &[u32],
        dy: &[T],
        place: OutputRows,
    ) {
        let (dw, db) = layer.w_b_mut(gradient);
        db.fill(T::ZERO);
        for dy in dy.chunks_exact(place.stride) {
            add(db, &dy[place.offset..place.offset + layer.n_out], T::ONE);
        }
        self.weight_gradient(threads, layer, dw, db, which, dy, place, 0);
    }

    /// The columns of dW from pixel `first` on.
    #[allow(clippy::too_many_arguments, reason = "the recursion carries all of the caller's")]
    fn weight_gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        dw: &mut [T],
        db: &[T],
        which: &[u32],
        dy: &[T],
        place: OutputRows,
        first: usize,
    ) {
        let pixels = dw.len() / layer.n_out;
        if threads > 1 && pixels > 1 {
            let (left, right) = dw.split_at_mut(pixels / 2 * layer.n_out);
            let (half, rest) = (threads / 2, threads - threads / 2);
            join(
                threads,
                || self.weight_gradient(half, layer, left, db, which, dy, place, first),
                || self.weight_gradient(rest, layer, right, db, which, dy, place, first + pixels / 2),
            );
            return;
        }
        arch().dispatch(WeightGradient { images: self, n_out: layer.n_out, dw, db, which, dy, place, first });
    }
}

/// See [`BinaryImages::factors`].
struct Factors<T>([T; LEVELS]);

impl<T: Real> Factors<T> {
    #[inline(always)]
    fn of(&self, change: u32) -> T {
        if change & UNREAD == 0 { self.0[level(change)] } else { T::ZERO }
    }
}

/// Vectors of outputs that a loop over changes keeps in registers. A block of columns this wide stays in the cache next
/// to the nearest.
const VECTORS: usize = 4;

/// Cuts `width` into runs of `VECTORS` vectors, of one vector, and of single entries; calls `$run` with where each begins.
macro_rules! in_runs {
    ($self:ident, $simd:ident, $width:expr, $lanes:expr) => {{
        let (width, lanes) = ($width, $lanes);
        let mut at = 0;
        while at + VECTORS * lanes <= width {
            $self.run::<S, VECTORS>($simd, at);
            at += VECTORS * lanes;
        }
        while at + lanes <= width {
            $self.run::<S, 1>($simd, at);
            at += lanes;
        }
        $self.rest(at);
    }};
}

struct Affine<'a, T> {
    images: &'a BinaryImages,
    layer: &'a Linear,
    w: &'a [T],
    base: &'a [T],
    which: &'a [u32],
    y: &'a mut [T],
    place: OutputRows,
    relu: bool,
}

impl<T: Real> WithSimd for Affine<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        in_runs!(self, simd, self.layer.n_out, T::count::<S>());
    }
}

impl<T: Real> Affine<'_, T> {
    #[inline(always)]
    fn run<S: Simd, const V: usize>(&mut self, simd: S, at: usize) {
        let (n_out, lanes) = (self.layer.n_out, T::count::<S>());
        let base = T::cut::<S>(&self.base[at..at + V * lanes]);
        let factors = self.images.factors();
        let zero = T::splat(simd, T::ZERO);
        for (&image, y) in self.which.iter().zip(self.y.chunks_exact_mut(self.place.stride)) {
            let mut sums: [T::V<S>; V] = std::array::from_fn(|v| base[v]);
            for &change in self.images.changes(image) {
                let factor = T::splat(simd, factors.of(change));
                let w = T::cut::<S>(&self.w[entry(change) * n_out + at..][..V * lanes]);
                for v in 0..V {
                    sums[v] = T::mul_add(simd, factor, w[v], sums[v]);
                }
            }
            let y = T::cut_mut::<S>(&mut y[self.place.offset + at..][..V * lanes]);
            for v in 0..V {
                y[v] = if self.relu { T::max(simd, sums[v], zero) } else { sums[v] };
            }
        }
    }

    #[inline(always)]
    fn rest(&mut self, at: usize) {
        let (n_out, factors) = (self.layer.n_out, self.images.factors::<T>());
        for (&image, y) in self.which.iter().zip(self.y.chunks_exact_mut(self.place.stride)) {
            let y = &mut y[self.place.offset..][at..n_out];
            y.copy_from_slice(&self.base[at..]);
            for &change in self.images.changes(image) {
                let factor = factors.of(change);
                for (y, &w) in y.iter_mut().zip(&self.w[entry(change) * n_out + at..]) {
                    *y = factor.fma(w, *y);
                }
            }
            if self.relu {
                for y in y {
                    *y = y.larger(T::ZERO);
                }
            }
        }
    }
}

/// See [`BinaryImages::gradient`]: the columns of dW for the pixels from `first` on.
struct WeightGradient<'a, T> {
    images: &'a BinaryImages,
    n_out: usize,
    dw: &'a mut [T],
    db: &'a [T],
    which: &'a [u32],
    dy: &'a [T],
    place: OutputRows,
    first: usize,
}

impl<T: Real> WithSimd for WeightGradient<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        in_runs!(self, simd, self.n_out, T::count::<S>());
    }
}

impl<T: Real> WeightGradient<'_, T> {
    fn entries(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.dw.len() / self.n_out
    }

    /// What every column starts from: the pixels lit in the reference are lit in all images but for the changes.
    #[inline(always)]
    fn start(&mut self, at: usize, len: usize) {
        for (dw, &lit) in self.dw.chunks_exact_mut(self.n_out).zip(&self.images.reference[self.first..]) {
            let dw = &mut dw[at..at + len];
            if lit {
                dw.copy_from_slice(&self.db[at..at + len]);
            } else {
                dw.fill(T::ZERO);
            }
        }
    }

    #[inline(always)]
    fn run<S: Simd, const V: usize>(&mut self, simd: S, at: usize) {
        let (images, lanes) = (self.images, T::count::<S>());
        let factors = images.factors();
        self.start(at, V * lanes);
        for (&image, dy) in self.which.iter().zip(self.dy.chunks_exact(self.place.stride)) {
            let dy = T::cut::<S>(&dy[self.place.offset + at..][..V * lanes]);
            let dy: [T::V<S>; V] = std::array::from_fn(|v| dy[v]);
            for &change in images.changes_at(image, self.entries()) {
                let factor = T::splat(simd, factors.of(change));
                let entry = entry(change) - self.first;
                let dw = T::cut_mut::<S>(&mut self.dw[entry * self.n_out + at..][..V * lanes]);
                for v in 0..V {
                    dw[v] = T::mul_add(simd, factor, dy[v], dw[v]);
                }
            }
        }
    }

    #[inline(always)]
    fn rest(&mut self, at: usize) {
        let (images, n_out, factors) = (self.images, self.n_out, self.images.factors::<T>());
        self.start(at, n_out - at);
        for (&image, dy) in self.which.iter().zip(self.dy.chunks_exact(self.place.stride)) {
            let dy = &dy[self.place.offset..][at..n_out];
            for &change in images.changes_at(image, self.entries()) {
                let (entry, factor) = (entry(change) - self.first, factors.of(change));
                for (dw, &dy) in self.dw[entry * n_out..][at..n_out].iter_mut().zip(dy) {
                    *dw = factor.fma(dy, *dw);
                }
            }
        }
    }
}

/// Where a layer's outputs lie in a longer column.
#[derive(Debug, Clone, Copy)]
pub struct OutputRows {
    /// Length of the column.
    pub stride: usize,
    /// Where the outputs begin.
    pub offset: usize,
}

fn column<'a, T>(layer: &Linear, w: &'a [T], pixel: usize) -> &'a [T] {
    &w[pixel * layer.n_out..][..layer.n_out]
}

fn add<T: Real>(y: &mut [T], x: &[T], sign: T) {
    vectorize(
        #[inline(always)]
        || {
            for (y, &x) in y.iter_mut().zip(x) {
                *y = sign.fma(x, *y);
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::nn::{mat::Accumulate, mlp::Layout};

    #[test]
    fn differences_give_the_dense_product_and_its_gradient() {
        let mut rng = crate::num::rng::Rng::seed_from_u64(3);
        let (pixels, n_out, count) = (37, 5, 11);
        let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 4) == 0)).collect();
        let mut images = BinaryImages::new(&frames[..pixels]);
        images.extend(&frames);
        let mut layout = Layout::default();
        let layer = layout.linear("first", pixels, n_out);
        let arena: Vec<f64> = layout.initialize(&mut rng);
        let which: Vec<u32> = (0..count as u32).rev().collect();
        let x: Vec<f64> =
            which.iter().flat_map(|&i| &frames[i as usize * pixels..][..pixels]).map(|&p| p.into()).collect();
        let place = OutputRows { stride: n_out + 3, offset: 2 };

        let (mut base, mut dense) = (vec![0.0; n_out], vec![0.0; n_out * count]);
        let mut sparse = vec![0.0; place.stride * count];
        images.base(&layer, &arena, &mut base);
        images.affine(&layer, &arena, &base, &which, &mut sparse, place, true);
        layer.forward(&arena, &x, &mut dense, true);
        for (dense, sparse) in dense.chunks(n_out).zip(sparse.chunks(place.stride)) {
            assert!(dense.iter().zip(&sparse[2..]).all(|(a, b)| (a - b).abs() < 1e-14));
        }

        let dy: Vec<f64> = sparse.iter().enumerate().map(|(i, _)| (i as f64).sin()).collect();
        let dense_dy: Vec<f64> = dy.chunks(place.stride).flat_map(|dy| &dy[2..2 + n_out]).copied().collect();
        let [mut want, mut one, mut two] = [(); 3].map(|()| vec![0.0; layout.len]);
        layer.gradient(1, &mut want, Accumulate::Replace, &x, &dense_dy);
        images.gradient(1, &layer, &mut one, &which, &dy, place);
        images.gradient(2, &layer, &mut two, &which, &dy, place);
        assert!(want.iter().zip(&one).all(|(a, b)| (a - b).abs() < 1e-13));
        assert_eq!(one, two);
        assert_eq!(images.lit(3).count(), frames[3 * pixels..4 * pixels].iter().filter(|&&p| p != 0).count());
    }

    #[test]
    fn squares_are_read_as_the_share_of_their_pixels_that_is_lit() {
        let mut rng = crate::num::rng::Rng::seed_from_u64(4);
        let (patches, pixels, n_out, count) = (PooledPatches { columns: 12, side: 3 }, 6 * 12, 5, 7);
        let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
        let mut images = BinaryImages::pooled(pixels, patches);
        images.extend(&frames);
        let share = |image: usize, patch: usize| {
            let (top, left) = (patch / 4 * 3, patch % 4 * 3);
            let rows = (0..3).map(|row| image * pixels + (top + row) * 12 + left);
            rows.map(|at| frames[at..at + 3].iter().map(|&p| f64::from(p)).sum::<f64>()).sum::<f64>() / 9.0
        };
        let x: Vec<f64> = (0..count * 8).map(|i| share(i / 8, i % 8)).collect();
        for (image, x) in x.chunks(8).enumerate() {
            for (patch, lit) in images.lit(image as u32) {
                assert_eq!(lit as f64, (9.0 * x[patch]).round());
            }
        }

        let mut layout = Layout::default();
        let layer = layout.linear("first", 8, n_out);
        let arena: Vec<f64> = layout.initialize(&mut rng);
        let which: Vec<u32> = (0..count as u32).collect();
        let place = OutputRows { stride: n_out, offset: 0 };
        let (mut base, mut dense, mut sparse) = (vec![0.0; n_out], vec![0.0; n_out * count], vec![0.0; n_out * count]);
        images.base(&layer, &arena, &mut base);
        images.affine(&layer, &arena, &base, &which, &mut sparse, place, false);
        layer.forward(&arena, &x, &mut dense, false);
        assert!(dense.iter().zip(&sparse).all(|(a, b)| (a - b).abs() < 1e-14));

        let dy: Vec<f64> = (0..n_out * count).map(|i| (i as f64).sin()).collect();
        let [mut want, mut got] = [(); 2].map(|()| vec![0.0; layout.len]);
        layer.gradient(1, &mut want, Accumulate::Replace, &x, &dy);
        images.gradient(2, &layer, &mut got, &which, &dy, place);
        assert!(want.iter().zip(&got).all(|(a, b)| (a - b).abs() < 1e-13));
    }

    #[test]
    fn thinned_squares_are_read_right_on_average_and_decoded_whole() {
        let mut rng = Rng::seed_from_u64(6);
        let (patches, pixels, count) = (PooledPatches { columns: 4, side: 2 }, 16, 3);
        let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 2) == 0)).collect();
        let mut images = BinaryImages::pooled(pixels, patches);
        images.extend(&frames);
        let mut layout = Layout::default();
        let layer = layout.linear("first", 4, 2);
        let arena: Vec<f64> = layout.initialize(&mut rng);
        let read = |images: &BinaryImages, which: &[u32]| {
            let (mut base, mut y) = (vec![0.0; 2], vec![0.0; 2 * which.len()]);
            images.base(&layer, &arena, &mut base);
            images.affine(&layer, &arena, &base, which, &mut y, OutputRows { stride: 2, offset: 0 }, false);
            y
        };
        let whole = read(&images, &[2, 0]);
        let (mut mean, draws) = (vec![0.0; 4], 4000);
        for _ in 0..draws {
            let thinned = images.with_dropout(&[2, 0], 0.25, &mut rng);
            assert!(thinned.lit(0).eq(images.lit(2)) && thinned.lit(1).eq(images.lit(0)));
            let y = read(&thinned, &[0, 1]);
            mean.iter_mut().zip(y).for_each(|(mean, y)| *mean += y / f64::from(draws));
        }
        assert!(mean.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 0.03), "{mean:?} {whole:?}");
        assert_ne!(read(&images.with_dropout(&[2, 0], 0.25, &mut rng), &[0, 1]), whole);
    }
}
