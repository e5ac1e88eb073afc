//! The networks of an LCE model over one arena of parameters.

use super::{
    backward::Backward,
    decoder::{Decoder, DecoderPass},
    drift::{Drift, Quadratic},
    encoder::Encoder,
};
use crate::{
    nn::{
        binary_images::{BinaryImages, PooledPatches},
        heads,
        mlp::{Layout, Linear, Mlp, Pass},
    },
    num::{Real, rng::Rng},
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
    /// Frames, rows and columns of an observation where encoder and decoder are convolutional.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub convolution: Option<[usize; 3]>,
    /// PooledPatches that all networks read and predict pictures in; not together with convolutions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub squares: Option<PooledPatches>,
    /// Hidden layers of the encoder; convolutions put out the first.
    pub encoder: [usize; 2],
    /// Hidden layers of the decoder; convolutions start from the last.
    pub decoder: [usize; 2],
    /// Hidden layers of the dynamics.
    pub dynamics: [usize; 2],
    /// N_z, N_u, N_x and N_joint of the backward dynamics.
    pub backward: [usize; 4],
    /// Whether F has heads for its own slopes.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub slopes: bool,
    /// The anchor's drift.
    #[serde(default, skip_serializing_if = "Drift::is_none")]
    pub drift: Drift,
}

impl Sizes {
    /// The paper's sizes for the planar system.
    pub fn planar() -> Self {
        Self {
            pixels: 1600,
            latent: 2,
            action: 2,
            convolution: None,
            squares: None,
            encoder: [300, 300],
            decoder: [300, 300],
            dynamics: [20, 20],
            backward: [5, 5, 100, 100],
            slopes: false,
            drift: Drift::None,
        }
    }

    /// The paper's sizes for the pendulum's swing-up.
    pub fn swing_up() -> Self {
        Self {
            pixels: 2 * 48 * 48,
            latent: 3,
            action: 1,
            convolution: None,
            squares: None,
            encoder: [500, 500],
            decoder: [500, 500],
            dynamics: [30, 30],
            backward: [10, 10, 200, 200],
            slopes: false,
            drift: Drift::None,
        }
    }

    /// The paper's sizes for balancing the cart-pole.
    pub fn cart_pole() -> Self {
        Self {
            pixels: 2 * 80 * 80,
            latent: 8,
            action: 1,
            convolution: Some([2, 80, 80]),
            squares: None,
            encoder: [1000, 200],
            decoder: [200, 1000],
            dynamics: [40, 40],
            backward: [10, 10, 300, 300],
            slopes: false,
            drift: Drift::None,
        }
    }

    /// The paper's sizes for the three-link pendulum.
    pub fn three_pole() -> Self {
        Self { action: 3, encoder: [1000, 500], backward: [10, 10, 400, 400], ..Self::cart_pole() }
    }

    /// Numbers that networks read of a picture, and logits that they give it.
    pub fn entries(&self) -> usize {
        self.pixels / self.squares.map_or(1, PooledPatches::area)
    }
}

/// The networks: where each layer lies in the arena.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Nets {
    /// All layers by name.
    pub layout: Layout,
    /// E: picture -> Gaussian over z.
    pub encoder: Encoder,
    /// D: z -> Bernoulli logits of a picture.
    pub decoder: Decoder,
    /// F: (z, u) -> Gaussian over z', relative to z.
    pub dynamics: Mlp<3>,
    /// B: (z', u, x) -> Gaussian over z.
    pub(super) backward: Backward,
    /// What F's last hidden layer says of F's slopes at (z, u): A by rows, then B by rows (PCC, "amortized").
    pub slopes: Option<Linear>,
    /// h, the last in the arena.
    pub(super) drift: Option<Quadratic>,
}

impl Nets {
    /// Lays out the networks.
    pub fn new(sizes: &Sizes) -> Self {
        let mut layout = Layout::default();
        let [f0, f1] = sizes.dynamics;
        let encoder = Encoder::new(&mut layout, sizes);
        let decoder = Decoder::new(&mut layout, sizes);
        let dynamics = layout.mlp("dynamics", sizes.latent + sizes.action, [f0, f1, 2 * sizes.latent]);
        let backward = Backward::new(&mut layout, sizes);
        let slopes = || layout.linear("dynamics.slopes", f1, sizes.latent * (sizes.latent + sizes.action));
        let slopes = sizes.slopes.then(slopes);
        let drift = match sizes.drift {
            Drift::None => None,
            Drift::Quadratic => Some(Quadratic::new(&mut layout, sizes.latent)),
        };
        Self { layout, encoder, decoder, dynamics, backward, slopes, drift }
    }
}

/// Pictures that are encoded or decoded together.
pub(super) const AT_ONCE: usize = 128;

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
        let mut arena = nets.layout.initialize(rng);
        nets.drift.iter().for_each(|drift| drift.reset(&mut arena));
        Self { sizes, nets, arena, background }
    }

    /// The same networks under an anchor with another drift; a new one starts at zero.
    pub fn set_drift(&mut self, drift: Drift) {
        self.sizes.drift = drift;
        self.nets = Nets::new(&self.sizes);
        self.arena.resize(self.nets.layout.len, T::ZERO);
    }

    /// Pictures (bytes, non-zero is lit) in the form that this model reads.
    pub fn pictures(&self, frames: &[u8]) -> BinaryImages {
        let mut pictures = match self.sizes.squares {
            None => BinaryImages::new(&self.background),
            Some(squares) => BinaryImages::pooled(self.sizes.pixels, squares),
        };
        pictures.extend(frames);
        pictures
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
        let mut gaussian = vec![T::ZERO; 2 * n * columns];
        self.predict(&z_u, &mut pass, &mut gaussian);
        gaussian.chunks_exact(2 * n).flat_map(|gaussian| &gaussian[..n]).copied().collect()
    }

    /// Probabilities of the pixels for every column of z.
    pub fn decode(&self, z: &[T]) -> Vec<T> {
        let mut probabilities = Vec::with_capacity(z.len() / self.sizes.latent * self.sizes.pixels);
        let around = |pixel| self.sizes.squares.map_or(pixel, |squares| squares.around(pixel));
        let probability = |l: T| T::ONE / (T::ONE + (-l).e_to());
        self.each_logits(z, |logits| {
            probabilities.extend((0..self.sizes.pixels).map(|pixel| probability(logits[around(pixel)])));
        });
        probabilities
    }

    /// -ln D(x|z) of every picture at its code: how badly it reads, in nats.
    pub fn misreading(&self, pictures: &BinaryImages, codes: &[T]) -> Vec<T> {
        let mut nats = Vec::with_capacity(pictures.len());
        let mut delta = vec![T::ZERO; self.sizes.entries()];
        self.each_logits(codes, |logits| {
            nats.push(heads::bernoulli(logits, pictures, nats.len() as u32, T::ZERO, &mut delta));
        });
        nats
    }

    fn each_logits(&self, z: &[T], mut each: impl FnMut(&[T])) {
        let (decoder, n) = (&self.nets.decoder, self.sizes.latent);
        let mut kernels = decoder.packed_weights();
        decoder.pack(&self.arena, &mut kernels);
        let mut pass = DecoderPass::new(decoder, (z.len() / n).min(AT_ONCE), 1);
        for z in z.chunks(AT_ONCE * n) {
            let mut pass = pass.view(z.len() / n);
            decoder.forward(&self.arena, &kernels, z, &mut pass);
            pass.logits().0.chunks_exact(self.sizes.entries()).for_each(&mut each);
        }
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
