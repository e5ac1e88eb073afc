//! Convolutions compared with their definition, and on every instruction set and several threads.

use rand::SeedableRng as _;

use super::*;
use crate::{
    nn::mlp::Layout,
    num::{Real, instruction_sets::on_every_instruction_set, rng::Rng, sampling},
};

pub(super) const IMAGES: usize = 9;

/// Every shape of layer that the paper's networks have, on a small image that is no patch.
fn layers() -> [(&'static str, [usize; 2], [usize; 2], Resize); 5] {
    [
        ("stride 2", [6, 24], [32, 32], Resize::Down(2)),
        ("stride 2, odd sizes, few channels", [7, 5], [32, 10], Resize::Down(2)),
        ("stride 1, few channels", [4, 3], [10, 32], Resize::Down(1)),
        ("upsampled", [3, 12], [32, 32], Resize::Up([2, 2])),
        ("upsampled, to frames", [4, 6], [32, 2], Resize::Up([2, 4])),
    ]
}

pub(super) struct Case<T> {
    pub(super) stack: Stack<1>,
    pub(super) layout: Layout,
    pub(super) arena: Vec<T>,
    /// Inputs, and gradients with respect to the outputs, pixel by pixel with true channels.
    pub(super) x: Vec<T>,
    pub(super) d_y: Vec<T>,
}

pub(super) fn case<T: Real>(size: [usize; 2], channels: [usize; 2], resize: Resize) -> Case<T> {
    let mut rng = Rng::seed_from_u64(5);
    let mut layout = Layout::default();
    let stack = Stack { convs: [Conv::new(&mut layout, "conv", size, channels, resize, false)] };
    let arena = layout.initialize(&mut rng);
    let mut random = |len: usize| (0..len).map(|_| T::of(sampling::uniform(&mut rng, -1.0, 1.0).into())).collect();
    let x = random(IMAGES * size[0] * size[1] * channels[0]);
    let d_y = random(IMAGES * stack.convs[0].pixels());
    Case { stack, layout, arena, x, d_y }
}

/// Outputs, and the gradients with respect to inputs and parameters.
fn run<T: Real>(case: &Case<T>, threads: usize) -> [Vec<T>; 3] {
    let (stack, conv) = (&case.stack, &case.stack.convs[0]);
    let mut packed = stack.packed_weights();
    stack.pack(&case.arena, &mut packed);
    let mut buffers = StackPass::new(stack, IMAGES, 1);
    let mut pass = buffers.view(IMAGES);
    let fill = |i: usize, input: &mut [T]| conv.fill(&case.x, i, input);
    stack.forward(&packed, &mut pass, fill);
    let mut y = vec![T::ZERO; case.d_y.len()];
    for i in 0..IMAGES {
        let (core, true_len) = (conv.width(), conv.pixels());
        conv.flatten(&pass.layers.out[0][i * core..][..core], &mut y[i * true_len..][..true_len]);
        conv.unflatten(&case.d_y[i * true_len..][..true_len], &mut pass.layers.delta[0][i * core..][..core]);
    }
    let mut d_x = vec![T::ZERO; case.x.len()];
    stack.backward(&packed, &mut pass, Some(|i: usize, d: &[T]| conv.take(d, &mut d_x, i)));
    let mut gradient = vec![T::ZERO; case.layout.len];
    let mut shards = stack.shard_sums();
    stack.gradient(threads, &mut pass, &mut shards, &mut gradient, &fill);
    [y, d_x, gradient]
}

/// The definition: upsample, pad by 2, take every stride-th window.
pub(super) fn plainly(case: &Case<f64>, size: [usize; 2], [c_in, c_out]: [usize; 2], resize: Resize) -> Vec<f64> {
    let (w, b) = (case.stack.convs[0].weights.w(&case.arena), case.stack.convs[0].weights.b(&case.arena));
    let (scale, stride) = match resize {
        Resize::Down(stride) => (1, stride),
        Resize::Up(_) => (2, 1),
    };
    let [rows, columns] = size.map(|side| side * scale);
    let mut y = Vec::new();
    for x in case.x.chunks_exact(size[0] * size[1] * c_in) {
        for (row, column) in (0..rows).step_by(stride).flat_map(|r| (0..columns).step_by(stride).map(move |c| (r, c))) {
            let mut sums = b.to_vec();
            for (ky, kx) in (0..SIDE).flat_map(|ky| (0..SIDE).map(move |kx| (ky, kx))) {
                let (Some(r), Some(c)) = ((row + ky).checked_sub(2), (column + kx).checked_sub(2)) else { continue };
                if r >= rows || c >= columns {
                    continue;
                }
                let pixel = &x[(r / scale * size[1] + c / scale) * c_in..][..c_in];
                for (i, &x) in pixel.iter().enumerate() {
                    let w = &w[((ky * SIDE + kx) * c_in + i) * c_out..][..c_out];
                    sums.iter_mut().zip(w).for_each(|(sum, &w)| *sum += w * x);
                }
            }
            y.extend(sums);
        }
    }
    y
}

pub(super) fn inner<T: Real>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.f64() * b.f64()).sum()
}

#[test]
fn folded_convolutions_equal_the_definition() {
    for (name, size, channels, resize) in layers() {
        let case = case::<f64>(size, channels, resize);
        let [y, ..] = run(&case, 1);
        let want = plainly(&case, size, channels, resize);
        assert_eq!(y.len(), want.len(), "{name}");
        assert!(y.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-13), "{name}");
    }
}

#[test]
fn gradients_are_adjoint_to_the_convolution() {
    for (name, size, channels, resize) in layers() {
        let case = case::<f64>(size, channels, resize);
        let [y, d_x, gradient] = run(&case, 1);
        // y is linear in x beside the bias, and linear in the parameters.
        let zeros = Case {
            x: vec![0.0; case.x.len()],
            arena: case.arena.clone(),
            d_y: case.d_y.clone(),
            ..self::case(size, channels, resize)
        };
        let [bias, ..] = run(&zeros, 1);
        let linear: Vec<f64> = y.iter().zip(&bias).map(|(y, b)| y - b).collect();
        assert!((inner(&linear, &case.d_y) - inner(&d_x, &case.x)).abs() < 1e-10, "{name}: inputs");
        assert!((inner(&y, &case.d_y) - inner(&gradient, &case.arena)).abs() < 1e-10, "{name}: parameters");
    }
}

#[test]
fn single_precision_follows_double_precision() {
    for (name, size, channels, resize) in layers() {
        let (single, double) =
            (run(&case::<f32>(size, channels, resize), 1), run(&case::<f64>(size, channels, resize), 1));
        for (single, double) in single.iter().zip(&double) {
            let scale = double.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
            let near = single.iter().zip(double).all(|(&a, b)| (f64::from(a) - b).abs() < 1e-5 * scale);
            assert!(near, "{name}");
        }
    }
}

#[test]
fn neither_instruction_sets_nor_threads_change_a_bit() {
    for (name, size, channels, resize) in layers() {
        let case = case::<f32>(size, channels, resize);
        on_every_instruction_set(|| run(&case, 1));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().expect("threads");
        let one = run(&case, 1);
        for threads in 2..=4 {
            assert!(pool.install(|| run(&case, threads)) == one, "{name} on {threads} threads");
        }
    }
}
