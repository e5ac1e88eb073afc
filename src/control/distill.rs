//! Policy distillation: the image of the old policy under the new encoder (paper, equation "policy-distillation").

use super::agent::{Agent, clamp_log_sigma, log_sigma_is_free};
use crate::{
    nn::{
        adam::{Adam, AdamSettings},
        mat::Accumulate,
        mlp::Pass,
    },
    num::Real as _,
};

/// One step on `samples` observations: whitened (z, z_g) under the new encoder, and the old policy's Gaussians at the
/// same observations. Minimises KL(student || teacher) and gives its mean.
pub fn step(
    student: &mut Agent,
    adam: &mut Adam<f32>,
    learning_rate: f64,
    pass: &mut Pass<f32, 3>,
    gradient: &mut [f32],
    (inputs, teacher): (&[f32], &[f32]),
) -> f64 {
    let a = student.action;
    let samples = teacher.len() / (2 * a);
    let net = student.nets.actor.1;
    let mut pass = pass.view(samples);
    net.forward(&student.actor.arena, inputs, &mut pass);
    let mean = 1.0 / samples as f32;
    let mut sum = 0.0;
    for i in 0..samples {
        let gaussian = &mut pass.out[2][i * 2 * a..][..2 * a];
        let delta = &mut pass.delta[2][i * 2 * a..][..2 * a];
        let teacher = &teacher[i * 2 * a..][..2 * a];
        for k in 0..a {
            let free = log_sigma_is_free(gaussian[a + k]);
            clamp_log_sigma(&mut gaussian[a + k..=a + k]);
            // KL of the Gaussians before tanh, which is that of the squashed policies.
            let inverse = (-2.0 * teacher[a + k]).e_to();
            let difference = gaussian[k] - teacher[k];
            let ratio = (2.0 * gaussian[a + k]).e_to() * inverse;
            let log_ratio = teacher[a + k] - gaussian[a + k];
            sum += f64::from(log_ratio + 0.5 * (ratio + difference * difference * inverse) - 0.5);
            delta[k] = mean * difference * inverse;
            delta[a + k] = if free { mean * (ratio - 1.0) } else { 0.0 };
        }
    }
    net.backward(&student.actor.arena, &mut pass, None);
    net.gradient(1, gradient, Accumulate::Replace, inputs, &pass);
    adam.step(1, AdamSettings { learning_rate, weight_decay: 0.0 }, &mut student.actor.arena, gradient);
    sum / samples as f64
}
