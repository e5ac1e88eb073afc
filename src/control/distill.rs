//! Policy distillation: the image of the old policy under the new encoder (paper, equation "policy-distillation").

use super::{
    actor_kl::{VarianceRatio, actor_kl},
    agent::Agent,
};
use crate::nn::{
    adam::{Adam, AdamSettings},
    mat::Accumulate,
    mlp::Pass,
};

/// One Adam step that minimises the mean of KL(student || teacher). Returns this mean, and whether the student's
/// parameters are finite after the step.
///
/// `inputs` are whitened (z, z_g) under the new encoder. `teacher` holds the old policy's Gaussians at the same
/// observations, one column each.
pub fn step(
    student: &mut Agent,
    adam: &mut Adam<f32>,
    learning_rate: f64,
    pass: &mut Pass<f32, 3>,
    gradient: &mut [f32],
    (inputs, teacher): (&[f32], &[f32]),
) -> (f64, bool) {
    let width = 2 * student.action;
    let samples = teacher.len() / width;
    let net = student.nets.actor.mlp;
    let mut pass = pass.view(samples);
    net.forward(&student.actor.arena, inputs, &mut pass);
    let weight = 1.0 / samples as f32;
    let mut sum = 0.0;
    let (gaussians, deltas) = pass.output_and_delta();
    let columns = gaussians.chunks_exact_mut(width).zip(deltas.chunks_exact_mut(width));
    for ((gaussian, delta), teacher) in columns.zip(teacher.chunks_exact(width)) {
        actor_kl(gaussian, teacher, VarianceRatio::Product, weight, delta, |kl| sum += f64::from(kl));
    }
    net.backward(&student.actor.arena, &mut pass, None);
    net.gradient(1, gradient, Accumulate::Replace, inputs, &pass);
    let settings = AdamSettings { learning_rate, weight_decay: 0.0 };
    let is_finite = adam.step(1, settings, &mut student.actor.arena, gradient);
    (sum / samples as f64, is_finite)
}
