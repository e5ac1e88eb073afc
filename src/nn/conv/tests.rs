//! Convolutions against the plain definition, against each other, and on every instruction set.

use rand::SeedableRng as _;

use super::*;
use crate::{
    nn::binary_images::BinaryImages,
    num::{rng::Rng, sampling, simd::tests::on_every_instruction_set},
};

const IMAGES: usize = 9;

/// Every shape of layer that the paper's networks have, on a small image that is no patch.
fn layers() -> [(&'static str, [usize; 2], [usize; 2], Resize); 5] {
    [
        ("stride 2", [6, 24], [32, 32], Resize::Down(2)),
        ("stride 2, an odd image, few channels", [7, 5], [32, 10], Resize::Down(2)),
        ("stride 1, few channels", [4, 3], [10, 32], Resize::Down(1)),
        ("upsampled", [3, 12], [32, 32], Resize::Up([2, 2])),
        ("upsampled, to frames", [4, 6], [32, 2], Resize::Up([2, 4])),
    ]
}

struct Case<T> {
    stack: Stack<1>,
    layout: Layout,
    arena: Vec<T>,
    /// Inputs and gradients with respect to the outputs, pixel by pixel, true channels only.
    x: Vec<T>,
    d_y: Vec<T>,
}

fn case<T: Real>(size: [usize; 2], channels: [usize; 2], resize: Resize) -> Case<T> {
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
    let mut kernels = stack.packed_weights();
    stack.pack(&case.arena, &mut kernels);
    let mut buffers = StackPass::new(stack, IMAGES, 1);
    let mut pass = buffers.view(IMAGES);
    let fill = |i: usize, input: &mut [T]| conv.fill(&case.x, i, input);
    stack.forward(&kernels, &mut pass, fill);
    let mut y = vec![T::ZERO; case.d_y.len()];
    for i in 0..IMAGES {
        let (core, true_len) = (conv.width(), conv.pixels());
        conv.flatten(&pass.layers.out[0][i * core..][..core], &mut y[i * true_len..][..true_len]);
        conv.unflatten(&case.d_y[i * true_len..][..true_len], &mut pass.layers.delta[0][i * core..][..core]);
    }
    let mut d_x = vec![T::ZERO; case.x.len()];
    stack.backward(&kernels, &mut pass, Some(|i: usize, d: &[T]| conv.take(d, &mut d_x, i)));
    let mut gradient = vec![T::ZERO; case.layout.len];
    let mut shares = stack.shard_sums();
    stack.gradient(threads, &mut pass, &mut shares, &mut gradient, &fill);
    [y, d_x, gradient]
}

/// The definition: upsample, pad by 2, take every stride-th window.
fn plainly(case: &Case<f64>, size: [usize; 2], [c_in, c_out]: [usize; 2], resize: Resize) -> Vec<f64> {
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

fn inner<T: Real>(a: &[T], b: &[T]) -> f64 {
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

/// The encoder's kind of stack on small observations of two frames.
fn lit_stack() -> (SparseConvStack<2>, Layout) {
    let mut layout = Layout::default();
    let stack = SparseConvStack::new(&mut layout, "lit", (2, [12, 14]), 32, |layout| {
        [
            Conv::new(layout, "lit.1", [12, 14], [32, 32], Resize::Down(2), true),
            Conv::new(layout, "lit.2", [6, 7], [32, 10], Resize::Down(2), true),
        ]
    });
    (stack, layout)
}

/// Nothing, corners, a bar over both frames, everything, and noise; each compared with a background that has lit pixels.
fn images() -> Vec<u8> {
    let (frame, mut rng) = (12 * 14, Rng::seed_from_u64(6));
    let mut all = vec![vec![0; 2 * frame]; IMAGES];
    all[1][0] = 1;
    all[2][2 * frame - 1] = 1;
    all[3][5 * 14..5 * 14 + 9].fill(1);
    all[3][frame + 6 * 14..frame + 6 * 14 + 9].fill(1);
    all[4].fill(1);
    for image in &mut all[5..] {
        image.iter_mut().for_each(|p| *p = u8::from(sampling::uniform(&mut rng, 0.0, 1.0) < 0.03));
    }
    all.concat()
}

/// What comes out, pixel by pixel, and the gradient of its inner product with `d_flat`.
fn see<T: Real>(arena: &[T], d_flat: &[T], threads: usize) -> [Vec<T>; 2] {
    let (stack, layout) = lit_stack();
    let frames = images();
    let mut seen = BinaryImages::new(&frames[3 * 2 * 12 * 14..][..2 * 12 * 14]);
    seen.extend(&frames);
    let which: Vec<u32> = (0..IMAGES as u32).collect();
    let (mut ready, mut shares) = (stack.packed_weights(), stack.shard_sums());
    stack.pack(arena, &mut ready);
    let mut pass = SparseConvPass::new(&stack, IMAGES, 1);
    let mut flat = vec![T::ZERO; IMAGES * 3 * 4 * 10];
    stack.forward(arena, &ready, (&seen, &which), &mut pass.view(IMAGES), &mut flat);
    let mut d = d_flat.to_vec();
    crate::nn::mlp::mask(&mut d, &flat);
    let mut gradient = vec![T::ZERO; layout.len];
    stack.gradient(threads, (arena, &ready), &mut gradient, (&seen, &which), &mut pass, &d, &mut shares);
    [flat, gradient]
}

/// Random parameters of [`lit_stack`], and a gradient with respect to what comes out.
fn parameters<T: Real>() -> [Vec<T>; 2] {
    let mut rng = Rng::seed_from_u64(7);
    let (_, layout) = lit_stack();
    let mut random = |len: usize| (0..len).map(|_| T::of(sampling::uniform(&mut rng, -0.3, 0.3).into())).collect();
    [random(layout.len), random(IMAGES * 3 * 4 * 10)]
}

#[test]
fn spans_of_lit_pixels_leave_nothing_out() {
    let [arena, d_flat] = parameters::<f64>();
    let [flat, _] = see(&arena, &d_flat, 1);
    let (mut x, mut at) = (Vec::new(), 0);
    for frames in images().chunks_exact(2 * 12 * 14) {
        x.extend((0..12 * 14).flat_map(|pixel| [frames[pixel], frames[12 * 14 + pixel]]).map(f64::from));
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
fn gradients_through_spans_are_those_of_finite_differences() {
    let [arena, d_flat] = parameters::<f64>();
    let [_, gradient] = see(&arena, &d_flat, 1);
    let (_, layout) = lit_stack();
    // Each layer's weights and biases on their own, so that none hides behind another.
    let parts = [(0, 1600), (1600, 1632), (1632, 27_232), (27_232, 27_264), (27_264, 35_264), (35_264, layout.len)];
    for (from, to) in parts {
        let mut rng = Rng::seed_from_u64(8);
        let direction: Vec<f64> = (0..to - from).map(|_| sampling::uniform(&mut rng, -1.0, 1.0).into()).collect();
        let at = |step: f64| {
            let mut arena = arena.clone();
            arena[from..to].iter_mut().zip(&direction).for_each(|(p, d)| *p += step * d);
            inner(&see(&arena, &d_flat, 1)[0], &d_flat)
        };
        let numeric = (at(1e-7) - at(-1e-7)) / 2e-7;
        let analytic = inner(&gradient[from..to], &direction);
        assert!((numeric - analytic).abs() < 1e-5 * analytic.abs().max(1.0), "{from}..{to}: {numeric} {analytic}");
    }
}

#[test]
fn neither_instruction_sets_nor_threads_change_a_bit_through_spans() {
    let [arena, d_flat] = parameters::<f32>();
    on_every_instruction_set(|| see(&arena, &d_flat, 1));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().expect("threads");
    let one = see(&arena, &d_flat, 1);
    for threads in 2..=4 {
        assert!(pool.install(|| see(&arena, &d_flat, threads)) == one, "{threads} threads");
    }
}
