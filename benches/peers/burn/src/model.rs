//! The networks of the planar system and CARL's loss.

use burn::{
    module::Module,
    nn::{Linear, LinearConfig},
    tensor::{
        Device, Tensor,
        activation::{log_sigmoid, relu},
    },
};

use super::{
    data::Batch,
    sizes::{ACTION, BATCH, LATENT, PIXELS},
};

const CURVATURE_SIGMA: f32 = 0.1;
const HALF_LN_TAU: f32 = 0.918_938_5;
const PREDICTION: f32 = 1.0;
const CONSISTENCY: f32 = 7.0;

#[derive(Module, Debug)]
struct Mlp {
    first: Linear,
    second: Linear,
    last: Linear,
}

impl Mlp {
    fn new([i, h_1, h_2, o]: [usize; 4], device: &Device) -> Self {
        let layer = |i, o| LinearConfig::new(i, o).init(device);
        Self { first: layer(i, h_1), second: layer(h_1, h_2), last: layer(h_2, o) }
    }

    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.last.forward(relu(self.second.forward(relu(self.first.forward(x)))))
    }
}

/// B(z', u, x) -> Gaussian over z.
#[derive(Module, Debug)]
struct Backward {
    z: Linear,
    u: Linear,
    x: Linear,
    joint: Linear,
    head: Linear,
}

impl Backward {
    fn new([n_z, n_u, n_x, n_joint]: [usize; 4], device: &Device) -> Self {
        let layer = |i, o| LinearConfig::new(i, o).init(device);
        Self {
            z: layer(LATENT, n_z),
            u: layer(ACTION, n_u),
            x: layer(PIXELS, n_x),
            joint: layer(n_z + n_u + n_x, n_joint),
            head: layer(n_joint, 2 * LATENT),
        }
    }

    fn forward(&self, z: Tensor<2>, u: Tensor<2>, x: Tensor<2>) -> Tensor<2> {
        let parts = Tensor::cat(vec![self.z.forward(z), self.u.forward(u), self.x.forward(x)], 1);
        self.head.forward(relu(self.joint.forward(parts)))
    }
}

/// All networks.
#[derive(Module, Debug)]
pub struct Carl {
    encoder: Mlp,
    decoder: Mlp,
    dynamics: Mlp,
    backward: Backward,
}

fn columns(x: &Tensor<2>, first: usize, count: usize) -> Tensor<2> {
    x.clone().narrow(1, first, count)
}

fn block(x: &Tensor<2>, which: usize) -> Tensor<2> {
    x.clone().narrow(0, which * BATCH, BATCH)
}

fn sample(mu: &Tensor<2>, log_sigma: &Tensor<2>, epsilon: Tensor<2>) -> Tensor<2> {
    mu.clone() + log_sigma.clone().exp() * epsilon
}

impl Carl {
    pub fn new(device: &Device) -> Self {
        Self {
            encoder: Mlp::new([PIXELS, 300, 300, 2 * LATENT], device),
            decoder: Mlp::new([LATENT, 300, 300, PIXELS], device),
            dynamics: Mlp::new([LATENT + ACTION, 20, 20, 2 * LATENT], device),
            backward: Backward::new([5, 5, 100, 100], device),
        }
    }

    /// The weighted loss of a batch; `noise` holds a row for every sample.
    pub fn loss(&self, batch: &Batch, noise: Tensor<2>) -> Tensor<1> {
        let n = LATENT;
        let u = &batch.actions;
        let [for_z_1, for_z_q, for_z_e] = [0, 1, 2].map(|i| columns(&noise, i * n, n));
        let codes = self.encoder.forward(batch.now_and_after.clone());
        let (now, next) = (block(&codes, 0), block(&codes, 1));
        let (mu_now, log_now) = (columns(&now, 0, n), columns(&now, n, n));
        let (mu_next, log_next) = (columns(&next, 0, n), columns(&next, n, n));
        let z_1 = sample(&mu_next, &log_next, for_z_1);
        let z_e = sample(&mu_now, &log_now, for_z_e);
        let seen = self.backward.forward(z_1.clone(), u.clone(), batch.now.clone());
        let (mu_q, log_q) = (columns(&seen, 0, n), columns(&seen, n, n));
        let z_q = sample(&mu_q, &log_q, for_z_q);

        let way = columns(&noise, 3 * n, n + ACTION) * CURVATURE_SIGMA;
        let (heads, tangent) = self.predict(&z_q, &mu_now, z_e.clone().detach(), u, way);
        let relative = columns(&heads, 0, n);
        let rest = block(&relative, 3) - block(&relative, 2) - tangent;
        let curvature = rest.square().sum();
        let mean = mu_now.clone() + block(&relative, 1);
        let decoded = self.decode(z_1.clone(), z_e, mean, batch);

        let entropy = log_next.sum() + BATCH as f32 * n as f32 * (HALF_LN_TAU + 0.5);
        let log_f = block(&columns(&heads, n, n), 0);
        let density = log_density(z_1, z_q + block(&relative, 0), log_f);
        let consistency = kl(mu_q, log_q, mu_now, log_now) - density - entropy;
        (decoded + consistency * (PREDICTION + CONSISTENCY) + curvature) / BATCH as f32
    }

    /// F on (z_q, u), (mean E(x), u), (z_e, u) and a point nearby; the directional derivative of its means at the third.
    /// burn has no forward mode, so the derivative is spelt out: the same affine layers without bias, under ReLU's masks.
    fn predict(
        &self,
        z_q: &Tensor<2>,
        mu_now: &Tensor<2>,
        z_e: Tensor<2>,
        u: &Tensor<2>,
        way: Tensor<2>,
    ) -> (Tensor<2>, Tensor<2>) {
        let f = &self.dynamics;
        let with_u = |z: &Tensor<2>| Tensor::cat(vec![z.clone(), u.clone()], 1);
        let at = with_u(&z_e);
        let near = at.clone() + way.clone();
        let z_u = Tensor::cat(vec![with_u(z_q), with_u(mu_now), at, near], 0);
        let h_1 = relu(f.first.forward(z_u));
        let h_2 = relu(f.second.forward(h_1.clone()));
        let heads = f.last.forward(h_2.clone());
        let dark = |h: &Tensor<2>| block(h, 2).detach().lower_equal_elem(0.0);
        let tangent = way.matmul(f.first.weight.val()).mask_fill(dark(&h_1), 0.0);
        let tangent = tangent.matmul(f.second.weight.val()).mask_fill(dark(&h_2), 0.0);
        (heads, tangent.matmul(columns(&f.last.weight.val(), 0, LATENT)))
    }

    /// The three reconstructions, weighted, summed over samples.
    fn decode(&self, z_1: Tensor<2>, z_e: Tensor<2>, mean: Tensor<2>, batch: &Batch) -> Tensor<1> {
        let logits = self.decoder.forward(Tensor::cat(vec![z_1, z_e, mean], 0));
        // softplus(l) - x l = (1 - x) l - ln sigmoid(l), which is two passes; burn's softplus is seven.
        let rows = (logits.clone() * batch.dark.clone() - log_sigmoid(logits)).sum_dim(1);
        let [predicted, encoded, deterministic] = [0, 1, 2].map(|i| block(&rows, i).sum());
        predicted * PREDICTION + encoded * 0.01 + deterministic * 0.3
    }
}

fn kl(mu_q: Tensor<2>, log_q: Tensor<2>, mu_p: Tensor<2>, log_p: Tensor<2>) -> Tensor<1> {
    let inverse = (log_p.clone() * -2.0).exp();
    let spread = (log_q.clone() * 2.0).exp() + (mu_q - mu_p).square();
    (log_p - log_q + spread * inverse * 0.5 - 0.5).sum()
}

fn log_density(z: Tensor<2>, mu: Tensor<2>, log_sigma: Tensor<2>) -> Tensor<1> {
    let unit = (z - mu) * (-log_sigma.clone()).exp();
    -(unit.square() * 0.5 + log_sigma + HALF_LN_TAU).sum()
}
