//! Binary images, stored as their differences from a reference image, and first layers that use this form.
//!
//! The images of a task share their background, and an agent covers few pixels. So `W x` is `W x_reference` plus a few
//! columns of W. The result is exact, and it takes about a tenth of the work of a dense product.
//!
//! A pixel is *lit* where its value is 1. An *entry* is what a network reads as one number: a pixel, or a patch of
//! pixels ([`PooledPatches`]).

mod change;
mod first_layer;
mod kernels;
mod pooled_patches;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::num::{Real, rng::Rng, sampling};

use change::{Change, LevelValues};
pub use first_layer::OutputRows;
pub use pooled_patches::PooledPatches;

/// A list of images of one size with pixels 0 and 1.
#[derive(Debug, Clone, PartialEq)]
pub struct BinaryImages {
    pixels: usize,
    patches: Option<Patches>,
    reference: Arc<Reference>,
    /// Where the changes of each image begin, then their total number.
    starts: Vec<u32>,
    /// The changes of all images; those of one image are sorted by entry.
    changes: Vec<Change>,
    /// Factor on every change that a network reads, so that dropout keeps means.
    dropout_scale: f64,
}

/// The patches that networks read and predict.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Patches {
    read: PooledPatches,
    /// The side is a multiple of the side of `read`.
    predicted: PooledPatches,
}

/// The image that all others are compared with.
#[derive(Debug, PartialEq)]
struct Reference {
    /// For every entry, whether it is lit.
    is_lit: Vec<bool>,
    /// The lit entries.
    lit: Vec<u32>,
}

impl BinaryImages {
    /// An empty list of images that are stored as differences from `reference`, one byte per pixel.
    pub fn new(reference: &[u8]) -> Self {
        let lit = (0_u32..).zip(reference).filter(|&(_, &p)| p != 0).map(|(pixel, _)| pixel).collect();
        let is_lit = reference.iter().map(|&p| p != 0).collect();
        Self::empty(reference.len(), None, Reference { is_lit, lit })
    }

    /// An empty list of images with `pixels` pixels. Networks read them as the patches `read` and predict the patches
    /// `predicted`. The side of `predicted` is a multiple of the side of `read`. The reference is dark.
    pub fn pooled(pixels: usize, read: PooledPatches, predicted: PooledPatches) -> Self {
        let reference = Reference { is_lit: vec![false; pixels / read.area()], lit: Vec::new() };
        Self::empty(pixels, Some(Patches { read, predicted }), reference)
    }

    fn empty(pixels: usize, patches: Option<Patches>, reference: Reference) -> Self {
        let reference = Arc::new(reference);
        Self { pixels, patches, reference, starts: vec![0], changes: Vec::new(), dropout_scale: 1.0 }
    }

    /// Appends images, given one after the other with one byte per pixel. A pixel is lit where its byte is not 0.
    pub fn extend(&mut self, images: &[u8]) {
        match self.patches {
            None => self.extend_by_pixels(images),
            Some(patches) => self.extend_by_patches(images, patches.read),
        }
    }

    fn extend_by_pixels(&mut self, images: &[u8]) {
        for image in images.chunks_exact(self.pixels) {
            for (pixel, (&value, &in_reference)) in image.iter().zip(&self.reference.is_lit).enumerate() {
                let is_lit = value != 0;
                if is_lit != in_reference {
                    self.changes.push(Change::of_pixel(pixel as u32, is_lit));
                }
            }
            self.starts.push(self.changes.len() as u32);
        }
    }

    fn extend_by_patches(&mut self, images: &[u8], patches: PooledPatches) {
        let mut counts = vec![0; self.reference.is_lit.len()];
        for image in images.chunks_exact(self.pixels) {
            counts.fill(0);
            let lit = image.iter().enumerate().filter(|&(_, &value)| value != 0);
            lit.for_each(|(pixel, _)| counts[patches.around(pixel)] += 1);
            let with_lit_pixels = (0..).zip(&counts).filter(|&(_, &count)| count > 0);
            self.changes.extend(with_lit_pixels.map(|(patch, &count)| Change::of_patch(patch, count)));
            self.starts.push(self.changes.len() as u32);
        }
    }

    /// A copy of the images `which` for one training step with dropout on the input. Networks read each lit patch with
    /// probability 1 - `share`, and scaled by 1 / (1 - `share`), so that means stay. [`BinaryImages::lit`], which
    /// decoders are compared with, still gives all patches.
    ///
    /// # Panics
    ///
    /// If networks read these images as pixels.
    pub fn with_dropout(&self, which: &[u32], share: f64, rng: &mut Rng) -> Self {
        assert!(self.patches.is_some(), "dropout is defined for patches only");
        let (mut starts, mut changes) = (vec![0], Vec::new());
        for &image in which {
            let keep_or_drop = |&change: &Change| {
                let is_dropped = f64::from(sampling::uniform(rng, 0.0, 1.0)) < share;
                if is_dropped { change.dropped() } else { change }
            };
            changes.extend(self.changes(image).iter().map(keep_or_drop));
            starts.push(changes.len() as u32);
        }
        let reference = Arc::clone(&self.reference);
        Self {
            pixels: self.pixels,
            patches: self.patches,
            reference,
            starts,
            changes,
            dropout_scale: 1.0 / (1.0 - share),
        }
    }

    /// The number of pixels for which a decoder predicts one common number.
    pub fn predicted_area(&self) -> usize {
        self.patches.map_or(1, |patches| patches.predicted.area())
    }

    /// The number of frames into which an image divides for a layer that reads `n_in` entries at a time.
    pub fn frames(&self, n_in: usize) -> usize {
        self.reference.is_lit.len() / n_in
    }

    /// Number of images.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there are no images.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The target of a decoder for an image: indices of predicted pixels or patches, each with a number of lit pixels.
    /// If an index comes several times, its numbers add up.
    pub fn lit(&self, image: u32) -> impl Iterator<Item = (usize, usize)> + '_ {
        let by_pixels = self.patches.is_none();
        let is_dark = move |change: Change| by_pixels && change.is_dark();
        let is_darkened = move |pixel| self.changes(image).iter().any(|&c| c.entry() == pixel && is_dark(c));
        let kept = self.reference_lit().filter(move |&pixel| !is_darkened(pixel)).map(|pixel| (pixel, 1));
        let changed = self.changes(image).iter().filter(move |&&change| !is_dark(change));
        kept.chain(changed.map(move |&change| match self.patches {
            None => (change.entry(), 1),
            Some(Patches { read, predicted }) => (predicted.around_patch(read, change.entry()), change.level()),
        }))
    }

    /// The lit entries of the reference.
    fn reference_lit(&self) -> impl Iterator<Item = usize> + '_ {
        self.reference.lit.iter().map(|&entry| entry as usize)
    }

    /// The changes of an image, sorted by entry.
    #[inline]
    fn changes(&self, image: u32) -> &[Change] {
        &self.changes[self.starts[image as usize] as usize..self.starts[image as usize + 1] as usize]
    }

    /// The changes of an image at some entries.
    #[inline]
    fn changes_at(&self, image: u32, entries: std::ops::Range<usize>) -> &[Change] {
        let changes = self.changes(image);
        if entries.len() == self.reference.is_lit.len() {
            return changes;
        }
        let before = |at: usize| changes.partition_point(|change| change.entry() < at);
        &changes[before(entries.start)..before(entries.end)]
    }

    /// What changes add to the entries that a network reads.
    fn level_values<T: Real>(&self) -> LevelValues<T> {
        self.patches
            .map_or_else(LevelValues::of_pixels, |patches| LevelValues::of_patches(patches.read, self.dropout_scale))
    }
}
