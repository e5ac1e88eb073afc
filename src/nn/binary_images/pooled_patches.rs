//! Square patches of pixels, each pooled into one number.

/// Patches of `side` times `side` pixels that tile an image. A network reads one number per patch, the share of its
/// pixels that is lit, and a decoder gives one logit per patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PooledPatches {
    /// Columns of the image, a multiple of `side`.
    pub columns: usize,
    /// Rows and columns of a patch, at most 15.
    pub side: usize,
}

impl PooledPatches {
    /// Pixels of a patch.
    pub fn area(self) -> usize {
        self.side * self.side
    }

    /// The index of the patch that holds a pixel. Patches, like pixels, are numbered row by row.
    pub fn around(self, pixel: usize) -> usize {
        let (row, column) = (pixel / self.columns, pixel % self.columns);
        row / self.side * (self.columns / self.side) + column / self.side
    }

    /// The index of the patch that holds patch `patch` of the patches `smaller`. The side of `smaller` divides this
    /// side.
    #[inline]
    pub(super) fn around_patch(self, smaller: Self, patch: usize) -> usize {
        if smaller == self {
            return patch;
        }
        let in_row = smaller.columns / smaller.side;
        self.around(patch / in_row * smaller.side * self.columns + patch % in_row * smaller.side)
    }
}
