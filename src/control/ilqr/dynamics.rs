//! The dynamics that iLQR plans with: the next code, and its Jacobians.

use crate::{
    lce::LceModel,
    nn::mlp::{Linear, Mlp, Pass},
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

/// The mean of a model's F in double precision. The Jacobians are F's own, or, in an amortized model, those of its heads.
#[derive(Debug)]
pub struct LatentDynamics {
    net: Mlp<3>,
    arena: Vec<f64>,
    jacobian_head: Option<Linear>,
    latent: usize,
    z_u: Vec<f64>,
    pass: Pass<f64, 3>,
}

impl LatentDynamics {
    /// The mean of a model's F.
    pub fn of(model: &LceModel) -> Self {
        let layers = model.nets.dynamics.layers;
        let first = layers[0].at;
        let end = layers[2].at + layers[2].len();
        let double = |weights: &[f32]| weights.iter().map(|&weight| f64::from(weight)).collect::<Vec<_>>();
        let mut arena = double(&model.arena[first..end]);
        let jacobian_head = model.nets.jacobian_head.map(|head| {
            let at = arena.len();
            arena.extend(double(&model.arena[head.at..head.at + head.len()]));
            Linear { at, ..head }
        });
        let net = Mlp { layers: layers.map(|layer| Linear { at: layer.at - first, ..layer }) };
        let z_u = vec![0.0; layers[0].n_in];
        Self { pass: Pass::new(&net, 1, 1), net, arena, jacobian_head, latent: model.sizes.latent, z_u }
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
        let (mut a, mut b) = (Vec::with_capacity(n * n), Vec::with_capacity(n * u.len()));
        let mut row = vec![0.0; self.z_u.len()];
        for i in 0..n {
            pass.output_delta().fill(0.0);
            pass.output_delta()[i] = 1.0;
            self.net.backward(&self.arena, &mut pass, Some(&mut row));
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
    fn the_next_code_is_the_models_own_mean() {
        let model = model(Sizes::planar());
        let mut dynamics = LatentDynamics::of(&model);
        let mut next = [0.0; 2];
        dynamics.next(&[0.5, -1.25], &[0.75, -0.5], &mut next);
        let single = model.predict_mean(&[0.5, -1.25], &[0.75, -0.5]);
        assert!(next.iter().zip(single).all(|(double, single)| (double - f64::from(single)).abs() < 1e-6));
    }
}
