//! Transitions of the planar system, laid out in batches before anything is timed.

use burn::tensor::{Device, Tensor, TensorData};

use super::sizes::{ACTION, BATCH, PIXELS};

const SIDE: usize = 40;
const SAMPLES: usize = 2048;
const OBSTACLES: [[usize; 2]; 6] = [[20, 5], [20, 13], [20, 27], [20, 35], [10, 20], [30, 20]];

/// A batch: pictures as rows of zeros and ones.
pub struct Batch {
    pub now: Tensor<2>,
    /// x, then x'.
    pub now_and_after: Tensor<2>,
    /// One minus x', x, x': what the decoder's three parts are compared with.
    pub dark: Tensor<2>,
    pub actions: Tensor<2>,
}

/// Uniform in -1..1, from a linear congruential generator.
struct Uniform(u64);

impl Uniform {
    fn draw(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

fn picture(state: [f32; 2]) -> Vec<f32> {
    let mut pixels = vec![0.0; PIXELS];
    for [row, column] in OBSTACLES {
        for r in row - 2..=row + 2 {
            pixels[r * SIDE + column - 2..=r * SIDE + column + 2].fill(1.0);
        }
    }
    let [row, column] = state.map(|s| (20.0 + 18.0 * s.clamp(-1.0, 1.0)).round() as usize);
    for r in row - 1..=row {
        pixels[r * SIDE + column - 1..=r * SIDE + column].fill(1.0);
    }
    pixels
}

pub fn batches(device: &Device) -> Vec<Batch> {
    let mut uniform = Uniform(1);
    (0..SAMPLES / BATCH)
        .map(|_| {
            let (mut now, mut after, mut actions) = (Vec::new(), Vec::new(), Vec::new());
            for _ in 0..BATCH {
                let [state, action] = [(); 2].map(|()| [(); 2].map(|()| uniform.draw()));
                now.extend(picture(state));
                after.extend(picture([0, 1].map(|i| state[i] + 0.15 * action[i])));
                actions.extend(action);
            }
            let rows = |parts: &[&Vec<f32>], width: usize| {
                let all: Vec<f32> = parts.iter().flat_map(|part| part.iter().copied()).collect();
                let shape = [all.len() / width, width];
                Tensor::from_data(TensorData::new(all, shape), device)
            };
            Batch {
                now: rows(&[&now], PIXELS),
                now_and_after: rows(&[&now, &after], PIXELS),
                dark: rows(&[&after, &now, &after], PIXELS).neg() + 1.0,
                actions: rows(&[&actions], ACTION),
            }
        })
        .collect()
}
