//! Batches cut into parts for threads: all buffers of a training step are cut at the same sample.

use crate::num::Real;

/// A buffer with `width` numbers for every sample.
#[derive(Debug, Clone)]
pub(crate) struct Block<T> {
    width: usize,
    /// All numbers, sample by sample.
    pub(crate) data: Vec<T>,
}

impl<T: Real> Block<T> {
    pub(crate) fn new(width: usize, samples: usize) -> Self {
        Self { width, data: vec![T::ZERO; width * samples] }
    }

    /// The first `samples` samples.
    pub(crate) fn view(&mut self, samples: usize) -> BlockMut<'_, T> {
        BlockMut { width: self.width, data: &mut self.data[..self.width * samples] }
    }
}

/// Some samples of a [`Block`].
#[derive(Debug)]
pub(crate) struct BlockMut<'a, T> {
    width: usize,
    pub(crate) data: &'a mut [T],
}

impl<T> BlockMut<'_, T> {
    /// The numbers of one sample.
    pub(crate) fn sample(&mut self, sample: usize) -> &mut [T] {
        &mut self.data[sample * self.width..][..self.width]
    }
}

/// Buffers that can be cut between two samples.
pub(crate) trait Cut: Sized {
    /// The first `samples` samples and the rest.
    fn cut(self, samples: usize) -> (Self, Self);
}

impl<T> Cut for BlockMut<'_, T> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let (left, right) = self.data.split_at_mut(samples * self.width);
        (Self { width: self.width, data: left }, Self { width: self.width, data: right })
    }
}

/// What all samples share is not cut.
impl<S: ?Sized> Cut for &S {
    fn cut(self, _: usize) -> (Self, Self) {
        (self, self)
    }
}

/// One entry for every sample.
impl<S> Cut for &mut [S] {
    fn cut(self, samples: usize) -> (Self, Self) {
        self.split_at_mut(samples)
    }
}

impl<C: Cut, const L: usize> Cut for [C; L] {
    fn cut(self, samples: usize) -> (Self, Self) {
        let mut rights = [const { None }; L];
        let mut next_right = rights.iter_mut();
        let lefts = self.map(|buffer| {
            let (left, right) = buffer.cut(samples);
            *next_right.next().expect("one right part for each buffer") = Some(right);
            left
        });
        (lefts, rights.map(|right| right.expect("cut above")))
    }
}

/// Declares a struct of buffers that are cut together.
macro_rules! cut_together {
    ($(#[$meta:meta])* $vis:vis struct $name:ident<$life:lifetime, T> { $( $field_vis:vis $field:ident : $ty:ty ),* $(,)? }) => {
        $(#[$meta])*
        $vis struct $name<$life, T> { $( $field_vis $field: $ty ),* }

        impl<T: $crate::num::Real> $crate::nn::columns::Cut for $name<'_, T> {
            fn cut(self, samples: usize) -> (Self, Self) {
                $( let $field = $crate::nn::columns::Cut::cut(self.$field, samples); )*
                (Self { $( $field: $field.0 ),* }, Self { $( $field: $field.1 ),* })
            }
        }
    };
}
pub(crate) use cut_together;

/// The greatest number of parts of a batch. Buffers that every thread needs for itself exist this many times.
pub(crate) const MAX_THREADS: usize = 16;

/// Runs `work` on all samples, cut into as many parts as there are threads. `work` gets the number of its first sample, its
/// number of samples, and their buffers.
pub(crate) fn over_samples<C, F>(threads: usize, first: usize, samples: usize, columns: C, work: &F)
where
    C: Cut + Send,
    F: Fn(usize, usize, C) + Sync,
{
    let threads = threads.min(MAX_THREADS);
    if threads <= 1 || samples < 2 {
        return work(first, samples, columns);
    }
    let half = samples / 2;
    let (left, right) = columns.cut(half);
    crate::num::join(
        threads,
        || over_samples(threads / 2, first, half, left, work),
        || over_samples(threads - threads / 2, first + half, samples - half, right, work),
    );
}
