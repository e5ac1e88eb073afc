use rand::SeedableRng as _;

use super::*;
use crate::{
    lce::{passive_dynamics::PassiveDynamics, sizes::ImageNetworks},
    num::sampling,
};

const SAMPLES: usize = 4;

struct Case {
    net: Backward,
    arena: Vec<f64>,
    z: Vec<f64>,
    u: Vec<f64>,
    images: BinaryImages,
    /// The loss is the sum of the Gaussians' entries with these weights.
    weights: Vec<f64>,
}

impl Case {
    fn new() -> Self {
        let sizes = Sizes {
            shades: None,
            jacobian_heads: false,
            locally_linear: false,
            passive_dynamics: PassiveDynamics::None,
            images: ImageNetworks::Dense,
            pixels: 17,
            latent: 2,
            action: 3,
            encoder: [1, 1],
            decoder: [1, 1],
            dynamics: [1, 1],
            backward: BackwardSizes { z: 3, u: 4, x: 5, joint: 6 },
        };
        let mut rng = crate::num::rng::Rng::seed_from_u64(1);
        let mut layout = Layout::default();
        let net = Backward::new(&mut layout, &sizes);
        let frames: Vec<u8> =
            (0..SAMPLES * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
        let mut images = BinaryImages::new(&frames[..sizes.pixels]);
        images.extend(&frames);
        let arena = layout.initialize(&mut rng);
        let mut random = |count: usize| (0..count).map(|_| f64::from(sampling::uniform(&mut rng, -1.0, 1.0))).collect();
        let (z, u, weights) = (random(2 * SAMPLES), random(3 * SAMPLES), random(4 * SAMPLES));
        Self { net, arena, z, u, images, weights }
    }

    fn which() -> Vec<u32> {
        (0..SAMPLES as u32).rev().collect()
    }

    fn forward(&self, arena: &[f64], z: &[f64], pass: &mut BackwardPass<f64>) -> f64 {
        pass.pack(arena, &self.images);
        let mut columns = pass.view(SAMPLES);
        columns.forward(arena, (z, &self.u), (&self.images, &Self::which()));
        columns.head.data.iter().zip(&self.weights).map(|(g, w)| g * w).sum()
    }

    fn value(&self, arena: &[f64], z: &[f64]) -> f64 {
        self.forward(arena, z, &mut BackwardPass::new(&self.net, SAMPLES))
    }
}

#[test]
fn gradients_equal_finite_differences() {
    let case = Case::new();
    let mut pass = BackwardPass::new(&case.net, SAMPLES);
    case.forward(&case.arena, &case.z, &mut pass);
    let mut columns = pass.view(SAMPLES);
    for i in 0..SAMPLES {
        columns.gaussian_and_gradient(i).1.copy_from_slice(&case.weights[4 * i..4 * i + 4]);
    }
    let before = 0.25;
    let (mut gradient, mut d_z) = (vec![7.0; case.arena.len()], vec![before; case.z.len()]);
    columns.backward(&case.arena, &mut d_z);
    pass.gradient(1, &mut gradient, (&case.z, &case.u), (&case.images, &Case::which()), SAMPLES);
    let near = |what: &str, at: usize, slope: f64, gradient: f64| {
        assert!((slope - gradient).abs() < 1e-7, "{what} {at}: the gradient says {gradient}, differences say {slope}");
    };
    let h = 1e-6;
    for (i, &gradient) in gradient.iter().enumerate() {
        let [above, below] = [h, -h].map(|step| {
            let mut arena = case.arena.clone();
            arena[i] += step;
            case.value(&arena, &case.z)
        });
        near("parameter", i, (above - below) / (2.0 * h), gradient);
    }
    for (i, d_z) in d_z.iter().enumerate() {
        let [above, below] = [h, -h].map(|step| {
            let mut z = case.z.clone();
            z[i] += step;
            case.value(&case.arena, &z)
        });
        // The gradient is added to the value from before.
        near("z", i, (above - below) / (2.0 * h), d_z - before);
    }
}
