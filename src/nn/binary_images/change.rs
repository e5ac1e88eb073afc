//! One entry of an image that differs from the reference image.

use super::PooledPatches;
use crate::num::Real;

const LEVEL_BITS: u32 = 8;
const LEVELS: usize = 1 << LEVEL_BITS;
/// The level of a pixel that is lit in the image and dark in the reference.
const LIT: u32 = 0;
/// The level of a pixel that is dark in the image and lit in the reference.
const DARK: u32 = 1;
/// Set in changes that dropout hides from the network.
const DROPPED: u32 = 1 << 31;

/// An entry's index and, in the lowest [`LEVEL_BITS`] bits, its level. The level of a patch is its number of lit pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change(u32);

impl Change {
    /// A pixel that is lit in exactly one of image and reference.
    pub(super) fn of_pixel(pixel: u32, is_lit: bool) -> Self {
        Self(pixel << LEVEL_BITS | if is_lit { LIT } else { DARK })
    }

    /// A patch with `count` lit pixels.
    pub(super) fn of_patch(patch: u32, count: u32) -> Self {
        Self(patch << LEVEL_BITS | count)
    }

    /// The same change, hidden from the network by dropout.
    pub(super) fn dropped(self) -> Self {
        Self(self.0 | DROPPED)
    }

    /// The entry's index.
    #[inline(always)]
    pub(super) fn entry(self) -> usize {
        ((self.0 & !DROPPED) >> LEVEL_BITS) as usize
    }

    /// The level.
    #[inline(always)]
    pub(super) fn level(self) -> usize {
        self.0 as usize % LEVELS
    }

    /// Whether a pixel is dark in the image and lit in the reference. Meaningless for patches.
    pub(super) fn is_dark(self) -> bool {
        self.level() == DARK as usize
    }
}

/// For every level, the number that a change of this level adds to its entry.
pub(super) struct LevelValues<T>([T; LEVELS]);

impl<T: Real> LevelValues<T> {
    /// The values for pixels: 1 and -1.
    pub(super) fn of_pixels() -> Self {
        let mut values = [T::ZERO; LEVELS];
        (values[LIT as usize], values[DARK as usize]) = (T::ONE, -T::ONE);
        Self(values)
    }

    /// The values for patches: the share of lit pixels times `scale`.
    pub(super) fn of_patches(patches: PooledPatches, scale: f64) -> Self {
        let mut values = [T::ZERO; LEVELS];
        let area = patches.area();
        for (count, value) in values[..=area].iter_mut().enumerate() {
            *value = T::of(count as f64 / area as f64 * scale);
        }
        Self(values)
    }

    /// What a change adds to its entry; 0 where dropout hides it.
    #[inline(always)]
    pub(super) fn of(&self, change: Change) -> T {
        if change.0 & DROPPED == 0 { self.0[change.level()] } else { T::ZERO }
    }
}
