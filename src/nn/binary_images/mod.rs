//! Images, stored as their differences from a reference image, and first layers that use this form.
//!
//! The images of a task share their background, and an agent covers few pixels. So `W x` is `W x_reference` plus a few
//! columns of W. The result is exact, and it takes about a tenth of the work of a dense product.
//!
//! A pixel is *lit* where its value is 1. In an image with shades, a pixel has a value from 0 to 1. An *entry* is what a network reads as one number: a pixel, or a patch of
//! pixels ([`PooledPatches`]).

mod change;
mod first_layer;
mod kernels;
mod pooled_patches;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::num::{Real, rng::Rng, sampling};

use change::{Change, LevelValues, WHITE, shade_of};
pub use first_layer::OutputRows;
pub use pooled_patches::PooledPatches;

/// How a decoder predicts the shades of pixels. Its output for an entry is the logit of a mean from 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Likelihood {
    /// As independent Bernoulli pixels. A shade counts as the share of draws that are lit.
    #[default]
    Bernoulli,
    /// As independent Gaussian pixels.
    Gaussian(Deviation),
}

/// The noise of Gaussian pixels.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Deviation {
    /// Standard deviation of a pixel, as a share of white.
    pub sigma: f64,
}

impl Default for Deviation {
    fn default() -> Self {
        Self { sigma: 0.3 }
    }
}

/// A list of images of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct BinaryImages {
    pixels: usize,
    /// `None` where every pixel is lit or not. Otherwise bytes are shades.
    shades: Option<Likelihood>,
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
    /// The byte of every entry.
    bytes: Vec<u8>,
    /// The entries that are not black.
    lit: Vec<u32>,
}

impl Reference {
    fn new(bytes: Vec<u8>) -> Self {
        let lit = (0_u32..).zip(&bytes).filter(|&(_, &byte)| byte != 0).map(|(entry, _)| entry).collect();
        Self { bytes, lit }
    }

    /// The value of an entry.
    fn value<T: Real>(&self, entry: usize) -> T {
        T::of(shade_of(self.bytes[entry]))
    }
}

/// The byte of a pixel in an image without shades: lit where it is not 0.
fn lit_or_not(byte: u8) -> u8 {
    if byte == 0 { 0 } else { WHITE }
}

impl BinaryImages {
    /// An empty list of images that are stored as differences from `reference`, one byte per pixel.
    pub fn new(reference: &[u8]) -> Self {
        let bytes = reference.iter().map(|&byte| lit_or_not(byte)).collect();
        Self::empty(reference.len(), None, Reference::new(bytes))
    }

    /// An empty list of images with shades that are stored as differences from `reference`, one byte per pixel.
    pub fn shaded(reference: &[u8], likelihood: Likelihood) -> Self {
        Self { shades: Some(likelihood), ..Self::empty(reference.len(), None, Reference::new(reference.to_vec())) }
    }

    /// An empty list of images with `pixels` pixels. Networks read them as the patches `read` and predict the patches
    /// `predicted`. The side of `predicted` is a multiple of the side of `read`. The reference is dark.
    pub fn pooled(pixels: usize, read: PooledPatches, predicted: PooledPatches) -> Self {
        let reference = Reference::new(vec![0; pixels / read.area()]);
        Self::empty(pixels, Some(Patches { read, predicted }), reference)
    }

    /// The same list of images with shades. It is empty still, and networks read patches.
    #[must_use]
    pub fn with_shades(self, likelihood: Likelihood) -> Self {
        debug_assert!(self.is_empty() && self.patches.is_some(), "a reference in pixels has shades of its own");
        Self { shades: Some(likelihood), ..self }
    }

    fn empty(pixels: usize, patches: Option<Patches>, reference: Reference) -> Self {
        let reference = Arc::new(reference);
        Self { pixels, shades: None, patches, reference, starts: vec![0], changes: Vec::new(), dropout_scale: 1.0 }
    }

    /// How a decoder predicts these images.
    pub fn likelihood(&self) -> Likelihood {
        self.shades.unwrap_or_default()
    }

    /// Appends images, given one after the other with one byte per pixel. Without shades, a pixel is lit where its byte is
    /// not 0.
    pub fn extend(&mut self, images: &[u8]) {
        match self.patches {
            None => self.extend_by_pixels(images),
            Some(patches) => self.extend_by_patches(images, patches.read),
        }
    }

    fn extend_by_pixels(&mut self, images: &[u8]) {
        let byte_of = self.byte_of();
        for image in images.chunks_exact(self.pixels) {
            for (pixel, (&byte, &in_reference)) in image.iter().zip(&self.reference.bytes).enumerate() {
                let byte = byte_of(byte);
                if byte != in_reference {
                    self.changes.push(Change::of_pixel(pixel as u32, byte, in_reference));
                }
            }
            self.starts.push(self.changes.len() as u32);
        }
    }

    fn extend_by_patches(&mut self, images: &[u8], patches: PooledPatches) {
        let mut sums = vec![0; self.reference.bytes.len()];
        let (byte_of, area) = (self.byte_of(), patches.area() as u32);
        for image in images.chunks_exact(self.pixels) {
            sums.fill(0);
            let lit = image.iter().enumerate().filter(|&(_, &value)| value != 0);
            lit.for_each(|(pixel, &byte)| sums[patches.around(pixel)] += u32::from(byte_of(byte)));
            let with_lit_pixels = (0..).zip(&sums).filter(|&(_, &sum)| sum > 0);
            self.changes.extend(with_lit_pixels.map(|(patch, &sum)| Change::of_patch(patch, sum, area)));
            self.starts.push(self.changes.len() as u32);
        }
    }

    /// What the byte of a pixel stands for.
    fn byte_of(&self) -> fn(u8) -> u8 {
        if self.shades.is_some() { |byte| byte } else { lit_or_not }
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
            shades: self.shades,
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
        self.reference.bytes.len() / n_in
    }

    /// Number of images.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there are no images.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The target of a decoder for an image: indices of predicted pixels or patches, each with a number of lit pixels. A
    /// grey pixel counts by its shade. If an index comes several times, its numbers add up.
    pub fn lit(&self, image: u32) -> impl Iterator<Item = (usize, f64)> + '_ {
        let mut changed = self.changes(image).iter().map(|change| change.entry()).peekable();
        let kept = self.reference_lit().filter(move |&entry| {
            // Both are sorted.
            while changed.next_if(|&changed| changed < entry).is_some() {}
            changed.peek() != Some(&entry)
        });
        let kept = kept.map(|entry| (entry, self.reference.value(entry)));
        kept.chain(self.changes(image).iter().filter_map(move |&change| match self.patches {
            None => match change.byte(self.reference.bytes[change.entry()]) {
                0 => None,
                byte => Some((change.entry(), shade_of(byte))),
            },
            Some(Patches { read, predicted }) => {
                Some((predicted.around_patch(read, change.entry()), change.lit_pixels(read.area())))
            }
        }))
    }

    /// The entries of the reference that are not black.
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
        if entries.len() == self.reference.bytes.len() {
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
