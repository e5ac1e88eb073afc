use rand::SeedableRng as _;

use super::*;
use crate::num::sampling;

const SAMPLES: usize = 4;

struct Case {
    net: Backward,
    arena: Vec<f64>,
    z: Vec<f64>,
    u: Vec<f64>,
    pictures: BinaryImages,
    /// The loss is the sum of the Gaussians' entries with these weights.
    weights: Vec<f64>,
}

impl Case {
    fn new() -> Self {
        let sizes = Sizes {
            slopes: false,
            drift: crate::lce::Drift::None,
            convolution: None,
            squares: None,
            pixels: 17,
            latent: 2,
            action: 3,
            encoder: [1, 1],
            decoder: [1, 1],
            dynamics: [1, 1],
            backward: [3, 4, 5, 6],
        };
        let mut rng = crate::num::rng::Rng::seed_from_u64(1);
        let mut layout = Layout::default();
        let net = Backward::new(&mut layout, &sizes);
        let frames: Vec<u8> =
            (0..SAMPLES * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
        let mut pictures = BinaryImages::new(&frames[..sizes.pixels]);
        pictures.extend(&frames);
        let arena = layout.initialize(&mut rng);
        let mut random = |count: usize| (0..count).map(|_| f64::from(sampling::uniform(&mut rng, -1.0, 1.0))).collect();
        let (z, u, weights) = (random(2 * SAMPLES), random(3 * SAMPLES), random(4 * SAMPLES));
        Self { net, arena, z, u, pictures, weights }
    }

    fn which() -> Vec<u32> {
        (0..SAMPLES as u32).rev().collect()
    }

    fn forward(&self, arena: &[f64], z: &[f64], pass: &mut BackwardMut<'_, f64>) -> f64 {
        let mut base = vec![0.0; self.net.x.n_out];
        self.net.base(arena, &self.pictures, &mut base);
        self.net.forward(arena, (z, &self.u), (&self.pictures, &base, &Self::which()), pass);
        pass.head.data.iter().zip(&self.weights).map(|(g, w)| g * w).sum()
    }

    fn value(&self, arena: &[f64], z: &[f64]) -> f64 {
        self.forward(arena, z, &mut BackwardPass::new(&self.net, SAMPLES).view(SAMPLES))
    }
}

#[test]
fn gradients_equal_finite_differences() {
    let case = Case::new();
    let mut pass = BackwardPass::new(&case.net, SAMPLES);
    let mut pass = pass.view(SAMPLES);
    case.forward(&case.arena, &case.z, &mut pass);
    for i in 0..SAMPLES {
        pass.gaussian_and_gradient(i).1.copy_from_slice(&case.weights[4 * i..4 * i + 4]);
    }
    let before = 0.25;
    let (mut gradient, mut d_z) = (vec![7.0; case.arena.len()], vec![before; case.z.len()]);
    case.net.backward(&case.arena, &mut pass, &mut d_z);
    case.net.gradient(1, &mut gradient, (&case.z, &case.u), (&case.pictures, &Case::which()), &pass);
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
        // The gradient is added to what is there.
        near("z", i, (above - below) / (2.0 * h), d_z - before);
    }
}
