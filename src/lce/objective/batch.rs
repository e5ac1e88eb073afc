//! One batch of the loss: images, actions, noise.

use crate::nn::binary_images::BinaryImages;

/// L_reg(E, E_-, pi, x) for sample `i` of the batch at the code z = mean E(x). Returns its value, and adds `weight` times
/// its gradient to `d_z`. The caller knows the old encoder and the frozen policy.
pub type Regularizer<'a, T> = &'a (dyn Fn(usize, &[T], T, &mut [T]) -> T + Sync);

/// One batch: which images, actions and noise. It contains no true state.
#[derive(Clone, Copy)]
pub struct Batch<'a, T> {
    /// All images.
    pub images: &'a BinaryImages,
    /// For every sample the numbers of x and x' among the images.
    pub pairs: &'a [u32],
    /// For every sample the number of x among the images.
    pub x: &'a [u32],
    /// Actions in -1..1, one column each.
    pub actions: &'a [T],
    /// Standard normal noise, [`Noise::width`] numbers for every sample.
    pub noise: &'a [T],
    /// Standard deviation of the curvature loss's noise.
    pub curvature_sigma: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
    /// Value-guided weights of L_p and L_c, one for every sample.
    pub guidance: Option<&'a [T]>,
    /// L_reg.
    pub regularizer: Option<Regularizer<'a, T>>,
}

impl<T> std::fmt::Debug for Batch<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Batch").field("samples", &self.x.len()).finish_non_exhaustive()
    }
}

/// One sample's noise in [`Batch::noise`], by what it is for.
#[derive(Debug, Clone, Copy)]
pub struct Noise<'a, T> {
    pub(super) z1: &'a [T],
    pub(super) z_q: &'a [T],
    pub(super) z_e: &'a [T],
    pub(super) curvature_z: &'a [T],
    pub(super) curvature_u: &'a [T],
}

impl<'a, T> Noise<'a, T> {
    /// How many numbers it has.
    pub fn width(latent: usize, action: usize) -> usize {
        4 * latent + action
    }

    /// The noise of sample `i`.
    #[inline(always)]
    pub(super) fn of(noise: &'a [T], latent: usize, action: usize, i: usize) -> Self {
        let width = Self::width(latent, action);
        let (z1, rest) = noise[i * width..][..width].split_at(latent);
        let (z_q, rest) = rest.split_at(latent);
        let (z_e, rest) = rest.split_at(latent);
        let (curvature_z, curvature_u) = rest.split_at(latent);
        Self { z1, z_q, z_e, curvature_z, curvature_u }
    }
}
