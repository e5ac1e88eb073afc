//! The box in the latent space that rollouts stay within.

/// Share of the data's width that the box is larger on every side.
const MARGIN: f32 = 0.2;

/// Bounds of every latent coordinate, which latent rollouts stay within.
#[derive(Debug)]
pub(super) struct LatentBox {
    pub(super) low: Vec<f32>,
    pub(super) high: Vec<f32>,
}

impl LatentBox {
    /// The box around the means of Gaussian codes, with a margin.
    pub(super) fn around(gaussians: &[f32], latent: usize) -> Self {
        let (mut low, mut high) = (vec![f32::MAX; latent], vec![f32::MIN; latent]);
        for code in gaussians.chunks_exact(2 * latent) {
            for i in 0..latent {
                (low[i], high[i]) = (low[i].min(code[i]), high[i].max(code[i]));
            }
        }
        for (low, high) in low.iter_mut().zip(&mut high) {
            let margin = (*high - *low) * MARGIN;
            (*low, *high) = (*low - margin, *high + margin);
        }
        Self { low, high }
    }

    /// One coordinate, moved to the nearest value within the box.
    #[inline(always)]
    pub(super) fn clamp(&self, coordinate: usize, value: f32) -> f32 {
        value.clamp(self.low[coordinate], self.high[coordinate])
    }
}
