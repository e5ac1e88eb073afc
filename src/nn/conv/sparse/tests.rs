//! Sparse convolutions compared with the definition, with finite differences, and on every instruction set.

use rand::SeedableRng as _;

use super::*;
use crate::{
    nn::{
        binary_images::Likelihood,
        conv::{
            Resize,
            tests::{IMAGES, case, inner, plainly},
        },
    },
    num::{instruction_sets::on_every_instruction_set, rng::Rng, sampling},
};

/// A small stack like the encoder's, on observations of two frames.
fn sparse_stack() -> (SparseConvStack<2>, Layout) {
    let mut layout = Layout::default();
    let stack = SparseConvStack::new(&mut layout, "sparse", (2, [12, 14]), 32, |layout| {
        [
            Conv::new(layout, "sparse.1", [12, 14], [32, 32], Resize::Down(2), true),
            Conv::new(layout, "sparse.2", [6, 7], [32, 10], Resize::Down(2), true),
        ]
    });
    (stack, layout)
}

/// Images: blank, single corners, a bar in both frames, full, and noise. The reference image is not blank.
fn images() -> Vec<u8> {
    let (frame, mut rng) = (12 * 14, Rng::seed_from_u64(6));
    let mut all = vec![vec![0; 2 * frame]; IMAGES];
    all[1][0] = 255;
    all[2][2 * frame - 1] = 255;
    all[3][5 * 14..5 * 14 + 9].fill(255);
    all[3][frame + 6 * 14..frame + 6 * 14 + 9].fill(100);
    all[4].fill(255);
    for image in &mut all[5..] {
        let mut byte =
            || (sampling::uniform(&mut rng, 0.0, 1.0) < 0.03) as u8 * [255, 80][sampling::index(&mut rng, 2)];
        image.iter_mut().for_each(|p| *p = byte());
    }
    all.concat()
}

/// The output, pixel by pixel, and the gradient of its inner product with `d_flat`.
fn run<T: Real>(arena: &[T], d_flat: &[T], threads: usize) -> [Vec<T>; 2] {
    let (stack, layout) = sparse_stack();
    let frames = images();
    let mut observations = BinaryImages::shaded(&frames[3 * 2 * 12 * 14..][..2 * 12 * 14], Likelihood::Bernoulli);
    observations.extend(&frames);
    let which: Vec<u32> = (0..IMAGES as u32).collect();
    let (mut weights, mut shards) = (stack.packed_weights(), stack.shard_sums());
    stack.pack(arena, &mut weights);
    let mut pass = SparseConvPass::new(&stack, IMAGES, 1);
    let mut flat = vec![T::ZERO; IMAGES * 3 * 4 * 10];
    stack.forward(arena, &weights, (&observations, &which), &mut pass.view(IMAGES), &mut flat);
    let mut d = d_flat.to_vec();
    crate::nn::mlp::mask(&mut d, &flat);
    let mut gradient = vec![T::ZERO; layout.len];
    stack.gradient(threads, (arena, &weights), &mut gradient, (&observations, &which), &mut pass, &d, &mut shards);
    [flat, gradient]
}

/// Random parameters of [`sparse_stack`], and a random gradient with respect to its output.
fn parameters<T: Real>() -> [Vec<T>; 2] {
    let mut rng = Rng::seed_from_u64(7);
    let (_, layout) = sparse_stack();
    let mut random = |len: usize| (0..len).map(|_| T::of(sampling::uniform(&mut rng, -0.3, 0.3).into())).collect();
    [random(layout.len), random(IMAGES * 3 * 4 * 10)]
}

#[test]
fn active_rows_leave_nothing_out() {
    let [arena, d_flat] = parameters::<f64>();
    let [flat, _] = run(&arena, &d_flat, 1);
    let (mut x, mut at) = (Vec::new(), 0);
    for frames in images().chunks_exact(2 * 12 * 14) {
        x.extend((0..12 * 14).flat_map(|pixel| [frames[pixel], frames[12 * 14 + pixel]]).map(|p| f64::from(p) / 255.0));
    }
    for (size, channels, stride) in [([12, 14], [2, 32], 1), ([12, 14], [32, 32], 2), ([6, 7], [32, 10], 2)] {
        let mut case = case::<f64>(size, channels, Resize::Down(stride));
        let len = case.arena.len();
        (case.arena, case.x) = (arena[at..at + len].to_vec(), x);
        x = plainly(&case, size, channels, Resize::Down(stride)).into_iter().map(|y| y.max(0.0)).collect();
        at += len;
    }
    assert_eq!(flat.len(), x.len());
    assert!(flat.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn gradients_through_active_rows_are_those_of_finite_differences() {
    let [arena, d_flat] = parameters::<f64>();
    let [_, gradient] = run(&arena, &d_flat, 1);
    let (_, layout) = sparse_stack();
    // Weights and biases of each layer are tested apart, because a small gradient would be lost beside a large one.
    let parts = [(0, 1600), (1600, 1632), (1632, 27_232), (27_232, 27_264), (27_264, 35_264), (35_264, layout.len)];
    for (from, to) in parts {
        let mut rng = Rng::seed_from_u64(8);
        let direction: Vec<f64> = (0..to - from).map(|_| sampling::uniform(&mut rng, -1.0, 1.0).into()).collect();
        let at = |step: f64| {
            let mut arena = arena.clone();
            arena[from..to].iter_mut().zip(&direction).for_each(|(p, d)| *p += step * d);
            inner(&run(&arena, &d_flat, 1)[0], &d_flat)
        };
        let numeric = (at(1e-7) - at(-1e-7)) / 2e-7;
        let analytic = inner(&gradient[from..to], &direction);
        assert!((numeric - analytic).abs() < 1e-5 * analytic.abs().max(1.0), "{from}..{to}: {numeric} {analytic}");
    }
}

#[test]
fn neither_instruction_sets_nor_threads_change_a_bit_of_sparse_convolutions() {
    let [arena, d_flat] = parameters::<f32>();
    on_every_instruction_set(|| run(&arena, &d_flat, 1));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().expect("threads");
    let one = run(&arena, &d_flat, 1);
    for threads in 2..=4 {
        assert!(pool.install(|| run(&arena, &d_flat, threads)) == one, "{threads} threads");
    }
}
