//! Two Gaussians of one sample, as they lie in a network's output.

/// Two Gaussians of one sample (means, then log standard deviations), and the gradients with respect to them.
#[derive(Debug)]
pub(super) struct GaussianPair<'a, T> {
    pub(super) first: &'a mut [T],
    pub(super) second: &'a mut [T],
    pub(super) d_first: &'a mut [T],
    pub(super) d_second: &'a mut [T],
}

impl<'a, T> GaussianPair<'a, T> {
    /// The pair of sample `i` in a network's `outputs` and `deltas`.
    #[inline(always)]
    pub(super) fn of((outputs, deltas): (&'a mut [T], &'a mut [T]), latent: usize, i: usize) -> Self {
        let (first, second) = outputs[4 * latent * i..][..4 * latent].split_at_mut(2 * latent);
        let (d_first, d_second) = deltas[4 * latent * i..][..4 * latent].split_at_mut(2 * latent);
        Self { first, second, d_first, d_second }
    }
}
