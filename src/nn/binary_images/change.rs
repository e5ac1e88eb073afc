//! One entry of an image that differs from the reference image.

use super::PooledPatches;
use crate::num::Real;

const LEVEL_BITS: u32 = 9;
const LEVELS: usize = 1 << LEVEL_BITS;
/// The byte of a lit pixel.
pub(super) const WHITE: u8 = 255;
/// The level of a pixel is above this where it is lighter than in the reference.
const SAME: i32 = 255;
/// The levels of patches from here on are bytes, and the levels below are numbers of lit pixels.
const FIRST_SHADE: u32 = 256;
/// Set in changes that dropout hides from the network.
const DROPPED: u32 = 1 << 31;

/// An entry's index and, in the lowest [`LEVEL_BITS`] bits, its level. The level of a pixel says how much lighter it is than
/// in the reference. The level of a patch of black and white pixels is its number of lit pixels; the level of another patch
/// is its mean byte.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change(u32);

impl Change {
    /// A pixel whose byte differs from the one in the reference.
    pub(super) fn of_pixel(pixel: u32, byte: u8, reference: u8) -> Self {
        Self(pixel << LEVEL_BITS | (SAME + i32::from(byte) - i32::from(reference)) as u32)
    }

    /// A patch whose `area` bytes have this sum.
    pub(super) fn of_patch(patch: u32, sum: u32, area: u32) -> Self {
        let white = u32::from(WHITE);
        let level = if sum.is_multiple_of(white) { sum / white } else { FIRST_SHADE + (sum + area / 2) / area };
        Self(patch << LEVEL_BITS | level)
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

    /// The byte of a pixel that has this one in the reference.
    pub(super) fn byte(self, reference: u8) -> u8 {
        (self.level() as i32 - SAME + i32::from(reference)) as u8
    }

    /// How many pixels of a patch are lit; a grey pixel counts by its shade.
    pub(super) fn lit_pixels(self, area: usize) -> f64 {
        match self.level() as u32 {
            count @ 0..FIRST_SHADE => f64::from(count),
            shade => shade_of((shade - FIRST_SHADE) as u8) * area as f64,
        }
    }
}

/// The shade of a byte: 0 for black, 1 for white.
pub(super) fn shade_of(byte: u8) -> f64 {
    f64::from(byte) / f64::from(WHITE)
}

/// For every level, the number that a change of this level adds to its entry.
pub(super) struct LevelValues<T>([T; LEVELS]);

impl<T: Real> LevelValues<T> {
    /// The values for pixels: from -1, for white in the reference and black in the image, to 1.
    pub(super) fn of_pixels() -> Self {
        Self(std::array::from_fn(|level| T::of(f64::from(level as i32 - SAME) / f64::from(WHITE))))
    }

    /// The values for patches: the share of lit pixels times `scale`.
    pub(super) fn of_patches(patches: PooledPatches, scale: f64) -> Self {
        let mut values = [T::ZERO; LEVELS];
        let (counts, shades) = values.split_at_mut(FIRST_SHADE as usize);
        let area = patches.area();
        for (count, value) in counts[..=area].iter_mut().enumerate() {
            *value = T::of(count as f64 / area as f64 * scale);
        }
        for (byte, value) in (0..=WHITE).zip(shades) {
            *value = T::of(shade_of(byte) * scale);
        }
        Self(values)
    }

    /// What a change adds to its entry; 0 where dropout hides it.
    #[inline(always)]
    pub(super) fn of(&self, change: Change) -> T {
        if change.0 & DROPPED == 0 { self.0[change.level()] } else { T::ZERO }
    }
}
