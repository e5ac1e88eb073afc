//! The dynamics that iLQR plans with: the next code, and its Jacobians.

use crate::{
    lce::{
        LceModel,
        dynamics::{self, DynamicsPass, Transition},
    },
    nn::mlp::Linear,
    num::linalg::Matrix,
};

/// The Jacobians of dynamics f at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Jacobians {
    /// A = ∂f/∂z.
    pub a: Matrix,
    /// B = ∂f/∂u.
    pub b: Matrix,
}

/// Deterministic dynamics that a plan can follow and linearise.
pub trait Dynamics {
    /// Width of a code.
    fn latent(&self) -> usize;
    /// Width of an action.
    fn action(&self) -> usize;
    /// Writes f(z, u).
    fn next(&mut self, z: &[f64], u: &[f64], next: &mut [f64]);
    /// The Jacobians of f at (z, u).
    fn jacobians(&mut self, z: &[f64], u: &[f64]) -> Jacobians;
}

/// The mean of a model's F in double precision. The Jacobians are those of F, or, in an amortized model, those of its
/// heads, or, in a locally linear F, A and B of its transition, as E2C plans.
#[derive(Debug)]
pub struct LatentDynamics {
    net: dynamics::Dynamics,
    arena: Vec<f64>,
    jacobian_head: Option<Linear>,
    latent: usize,
    z_u: Vec<f64>,
    pass: DynamicsPass<f64>,
}

impl LatentDynamics {
    /// The mean of a model's F.
    pub fn of(model: &LceModel) -> Self {
        let double = |weights: &[f32]| weights.iter().map(|&weight| f64::from(weight)).collect::<Vec<_>>();
        let mut arena = double(&model.arena[model.nets.dynamics.parameters()]);
        let jacobian_head = model.nets.jacobian_head.map(|head| {
            let at = arena.len();
            arena.extend(double(&model.arena[head.at..head.at + head.len()]));
            Linear { at, ..head }
        });
        let (net, latent) = (model.nets.dynamics.alone(), model.sizes.latent);
        let z_u = vec![0.0; latent + model.sizes.action];
        Self { pass: DynamicsPass::new(&net, 1, 1), net, arena, jacobian_head, latent, z_u }
    }

    fn forward(&mut self, z: &[f64], u: &[f64]) {
        self.z_u[..self.latent].copy_from_slice(z);
        self.z_u[self.latent..].copy_from_slice(u);
        self.net.forward(&self.arena, &self.z_u, &mut self.pass.view(1));
    }
}

impl Dynamics for LatentDynamics {
    fn latent(&self) -> usize {
        self.latent
    }

    fn action(&self) -> usize {
        self.z_u.len() - self.latent
    }

    fn next(&mut self, z: &[f64], u: &[f64], next: &mut [f64]) {
        self.forward(z, u);
        // F's means are relative to z; its log standard deviations come after them.
        for ((next, z), step) in next.iter_mut().zip(z).zip(self.pass.output()) {
            *next = z + step;
        }
    }

    fn jacobians(&mut self, z: &[f64], u: &[f64]) -> Jacobians {
        self.forward(z, u);
        let n = self.latent;
        let mut pass = self.pass.view(1);
        if let Some(head) = &self.jacobian_head {
            let mut a = vec![0.0; head.n_out];
            head.forward(&self.arena, pass.last_hidden(), &mut a, false);
            let b = a.split_off(n * n);
            return Jacobians { a: Matrix::new(n, a), b: Matrix::new(u.len(), b) };
        }
        if let Some(Transition { v, r, b, .. }) = self.net.transition(&pass) {
            let a = (0..n * n).map(|at| v[at / n] * r[at % n] + if at / n == at % n { 1.0 } else { 0.0 }).collect();
            return Jacobians { a: Matrix::new(n, a), b: Matrix::new(u.len(), b.to_vec()) };
        }
        let (mut a, mut b) = (Vec::with_capacity(n * n), Vec::with_capacity(n * u.len()));
        let mut row = vec![0.0; self.z_u.len()];
        for i in 0..n {
            let (_, delta) = pass.output_and_delta();
            delta.fill(0.0);
            delta[i] = 1.0;
            self.net.backward(&self.arena, &self.z_u, &mut pass, Some(&mut row));
            row[i] += 1.0;
            a.extend_from_slice(&row[..n]);
            b.extend_from_slice(&row[n..]);
        }
        Jacobians { a: Matrix::new(n, a), b: Matrix::new(u.len(), b) }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::{
        lce::{ImageNetworks, Sizes},
        num::{rng::Rng, sampling},
    };

    fn model(sizes: Sizes) -> LceModel {
        let pixels = sizes.pixels;
        LceModel::new(sizes, vec![0; pixels], &mut Rng::seed_from_u64(7))
    }

    #[test]
    fn jacobians_are_the_differences_of_the_mean_dynamics() {
        let mut rng = Rng::seed_from_u64(8);
        for sizes in [Sizes::planar(), Sizes::swing_up(), Sizes { images: ImageNetworks::Dense, ..Sizes::three_pole() }]
        {
            let mut dynamics = LatentDynamics::of(&model(sizes));
            let (n, width) = (dynamics.latent, dynamics.z_u.len());
            for _ in 0..20 {
                let mut z_u = vec![0.0; width];
                sampling::fill_normal(&mut rng, &mut z_u);
                let Jacobians { a, b } = dynamics.jacobians(&z_u[..n], &z_u[n..]);
                for input in 0..width {
                    let mut at = |way: f64| {
                        let mut moved = z_u.clone();
                        moved[input] += way;
                        let mut next = vec![0.0; n];
                        dynamics.next(&moved[..n], &moved[n..], &mut next);
                        next
                    };
                    let (up, down) = (at(1e-7), at(-1e-7));
                    for i in 0..n {
                        let slope = (up[i] - down[i]) / 2e-7;
                        let exact = if input < n { a.of(i, input) } else { b.of(i, input - n) };
                        assert!((slope - exact).abs() < 1e-7, "output {i}, input {input}: {slope} and {exact}");
                    }
                }
            }
        }
    }

    #[test]
    fn an_amortized_model_takes_its_jacobians_from_its_heads() {
        let mut model = model(Sizes { jacobian_heads: true, ..Sizes::swing_up() });
        let head = model.nets.jacobian_head.expect("a head");
        let (weights, biases) = head.w_b_mut(&mut model.arena);
        weights.fill(0.0);
        biases.iter_mut().zip(0_u8..).for_each(|(bias, i)| *bias = f32::from(i));
        let Jacobians { a, b } = LatentDynamics::of(&model).jacobians(&[0.1, 0.2, 0.3], &[0.4]);
        let is = |i: usize, j: usize| a.of(i, j) == (3 * i + j) as f64;
        assert!((0..3).all(|i| (0..3).all(|j| is(i, j)) && b.of(i, 0) == (9 + i) as f64));
    }

    #[test]
    fn a_locally_linear_model_plans_with_its_own_a_and_b() {
        let mut dynamics = LatentDynamics::of(&model(Sizes { locally_linear: true, ..Sizes::planar() }));
        let (z, u) = ([0.5, -1.25], [0.75, -0.5]);
        let Jacobians { a, b } = dynamics.jacobians(&z, &u);
        let mut at = |z: [f64; 2], u: [f64; 2]| {
            let mut next = [0.0; 2];
            dynamics.next(&z, &u, &mut next);
            next
        };
        let (rests, moves) = (at(z, [0.0; 2]), at(z, u));
        // A moves the code by rank one, and o is what is left at z.
        let rank = (a.of(0, 0) - 1.0) * (a.of(1, 1) - 1.0) - a.of(0, 1) * a.of(1, 0);
        assert!(rank.abs() < 1e-12 && a.of(0, 1) != 0.0, "A - I has rank one");
        for i in 0..2 {
            let pushed = b.of(i, 0) * u[0] + b.of(i, 1) * u[1];
            assert!((moves[i] - rests[i] - pushed).abs() < 1e-12, "F is linear in u");
        }
    }

    #[test]
    fn the_next_code_is_the_models_own_mean() {
        let model = model(Sizes::planar());
        let mut dynamics = LatentDynamics::of(&model);
        let mut next = [0.0; 2];
        dynamics.next(&[0.5, -1.25], &[0.75, -0.5], &mut next);
        let single = model.predict_mean(&[0.5, -1.25], &[0.75, -0.5]);
        assert!(next.iter().zip(single).all(|(double, single)| (double - f64::from(single)).abs() < 1e-6));
    }
}
