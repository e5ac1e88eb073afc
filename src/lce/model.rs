//! The networks of an LCE model over one arena of parameters.

use super::backward::Backward;
use crate::{
    nn::{
        Real, heads,
        mlp::{Layout, Mlp, Pass},
        pictures::{Pictures, Place},
    },
    rng::Rng,
};

/// Widths of all networks (paper, "Network Architectures").
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sizes {
    /// Pixels of an observation, x.
    pub pixels: usize,
    /// Dimension of the latent space, z.
    pub latent: usize,
    /// Dimension of the action, u.
    pub action: usize,
    /// Hidden layers of the encoder.
    pub encoder: [usize; 2],
    /// Hidden layers of the decoder.
    pub decoder: [usize; 2],
    /// Hidden layers of the dynamics.
    pub dynamics: [usize; 2],
    /// N_z, N_u, N_x and N_joint of the backward dynamics.
    pub backward: [usize; 4],
}

impl Sizes {
    /// The paper's sizes for the planar system.
    pub fn planar() -> Self {
        Self {
            pixels: 1600,
            latent: 2,
            action: 2,
            encoder: [300, 300],
            decoder: [300, 300],
            dynamics: [20, 20],
            backward: [5, 5, 100, 100],
        }
    }

    /// The paper's sizes for the pendulum.
    pub fn swing_up() -> Self {
        Self {
            pixels: 4608,
            latent: 3,
            action: 1,
            encoder: [500, 500],
            decoder: [500, 500],
            dynamics: [30, 30],
            backward: [10, 10, 200, 200],
        }
    }
}

/// The networks: where each layer lies in the arena.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Nets {
    /// All layers by name.
    pub layout: Layout,
    /// E: picture -> Gaussian over z.
    pub encoder: Mlp<3>,
    /// D: z -> Bernoulli logits of a picture.
    pub decoder: Mlp<3>,
    /// F: (z, u) -> Gaussian over z', relative to z.
    pub dynamics: Mlp<3>,
    /// B: (z', u, x) -> Gaussian over z.
    pub(super) backward: Backward,
}

impl Nets {
    /// Lays out the networks.
    pub fn new(sizes: &Sizes) -> Self {
        let mut layout = Layout::default();
        let [e0, e1] = sizes.encoder;
        let [d0, d1] = sizes.decoder;
        let [f0, f1] = sizes.dynamics;
        let encoder = layout.mlp("encoder", sizes.pixels, [e0, e1, 2 * sizes.latent]);
        let decoder = layout.mlp("decoder", sizes.latent, [d0, d1, sizes.pixels]);
        let dynamics = layout.mlp("dynamics", sizes.latent + sizes.action, [f0, f1, 2 * sizes.latent]);
        let backward = Backward::new(&mut layout, sizes);
        Self { layout, encoder, decoder, dynamics, backward }
    }
}

/// An LCE model: sizes, parameters, and the background that its pictures are compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct LceModel<T = f32> {
    /// Widths.
    pub sizes: Sizes,
    /// Where each layer lies.
    pub nets: Nets,
    /// All parameters.
    pub arena: Vec<T>,
    /// Pixels (0 or 1) that most of the first training pictures share. A matter of speed: pictures are stored as
    /// their differences from it.
    pub background: Vec<u8>,
}

impl<T: Real> LceModel<T> {
    /// A model with random parameters.
    pub fn new(sizes: Sizes, background: Vec<u8>, rng: &mut Rng) -> Self {
        let nets = Nets::new(&sizes);
        let arena = nets.layout.initialize(rng);
        Self { sizes, nets, arena, background }
    }

    /// Pictures (bytes, non-zero is lit) in the form that this model reads.
    pub fn pictures(&self, frames: &[u8]) -> Pictures {
        let mut pictures = Pictures::new(&self.background);
        pictures.extend(frames);
        pictures
    }

    /// E(·|x) for every picture: means, then log standard deviations, one column each.
    pub fn encode(&self, pictures: &Pictures) -> Vec<T> {
        let mut codes = Vec::with_capacity(2 * self.sizes.latent * pictures.len());
        let first = &self.nets.encoder.layers[0];
        let mut base = vec![T::nil(); first.n_out];
        pictures.base(first, &self.arena, &mut base);
        let mut pass = Pass::new(&self.nets.encoder, pictures.len().min(128), 1);
        let all: Vec<u32> = (0..pictures.len() as u32).collect();
        for which in all.chunks(128) {
            let mut pass = pass.view(which.len());
            let place = Place { stride: first.n_out, offset: 0 };
            pictures.affine(first, &self.arena, &base, which, pass.out[0], place, true);
            self.nets.encoder.forward_from_second(&self.arena, &mut pass);
            codes.extend_from_slice(pass.output());
        }
        codes
    }

    /// Means of E(·|x) for every picture, one column each.
    pub fn encode_means(&self, pictures: &Pictures) -> Vec<T> {
        let codes = self.encode(pictures);
        codes.chunks_exact(2 * self.sizes.latent).flat_map(|code| heads::halves(code).0).copied().collect()
    }

    /// F(·|z, u) for columns \[z; u\]: the output's means are relative to z and become absolute here.
    pub fn predict(&self, z_u: &[T], pass: &mut Pass<T, 3>, gaussian: &mut [T]) {
        let (width, n) = (self.sizes.latent + self.sizes.action, self.sizes.latent);
        let mut pass = pass.view(z_u.len() / width);
        self.nets.dynamics.forward(&self.arena, z_u, &mut pass);
        gaussian.copy_from_slice(pass.output());
        for (gaussian, z_u) in gaussian.chunks_exact_mut(2 * n).zip(z_u.chunks_exact(width)) {
            for i in 0..n {
                gaussian[i] += z_u[i];
            }
        }
    }

    /// Means of F(·|z, u) for columns of z and of u.
    pub fn predict_mean(&self, z: &[T], u: &[T]) -> Vec<T> {
        let (n, a) = (self.sizes.latent, self.sizes.action);
        let columns = z.len() / n;
        let z_u: Vec<T> =
            z.chunks_exact(n).zip(u.chunks_exact(a)).flat_map(|(z, u)| z.iter().chain(u)).copied().collect();
        let mut pass = Pass::new(&self.nets.dynamics, columns, 1);
        let mut gaussian = vec![T::nil(); 2 * n * columns];
        self.predict(&z_u, &mut pass, &mut gaussian);
        gaussian.chunks_exact(2 * n).flat_map(|gaussian| &gaussian[..n]).copied().collect()
    }

    /// Probabilities of the pixels for every column of z.
    pub fn decode(&self, z: &[T]) -> Vec<T> {
        let columns = z.len() / self.sizes.latent;
        let mut pass = Pass::new(&self.nets.decoder, columns, 1);
        let mut pass = pass.view(columns);
        self.nets.decoder.forward(&self.arena, z, &mut pass);
        pass.output().iter().map(|&l| T::unit() / (T::unit() + (-l).e_to())).collect()
    }
}

/// The pixels that are lit in most of the pictures, one picture's worth.
pub fn background(frames: &[u8], pixels: usize) -> Vec<u8> {
    let mut lit = vec![0_usize; pixels];
    for frame in frames.chunks_exact(pixels) {
        for (lit, &p) in lit.iter_mut().zip(frame) {
            *lit += usize::from(p != 0);
        }
    }
    lit.into_iter().map(|lit| u8::from(2 * lit * pixels > frames.len())).collect()
}
