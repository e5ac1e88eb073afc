//! Times the inner loops of training. Items are floating-point operations; a multiply-add counts as two. The first line
//! gives the peak of one thread, measured in this process.
//!
//!   cargo bench --bench kernels
//!   cargo bench --bench kernels -- convolution

#[path = "steps/peak.rs"]
mod peak;

use carl_pipe::{
    nn::{
        adam::{Adam, AdamSettings},
        binary_images::{BinaryImages, OutputRows},
        conv::{Conv, Resize, Stack, StackPass},
        heads,
        mat::{self, Accumulate},
        mlp::Layout,
    },
    num::rng::Rng,
};
use divan::{Bencher, counter::ItemsCount};
use rand::SeedableRng as _;

fn main() {
    println!("peak of one thread {:.0} GFLOP/s", peak::gflops());
    divan::main();
}

/// Fully connected layers as (inputs, outputs, samples): planar, swing-up, SAC, and two small ones.
const DENSE: [(usize, usize, usize); 6] =
    [(300, 1600, 384), (300, 300, 256), (500, 4608, 384), (256, 256, 128), (300, 4, 256), (20, 20, 640)];

fn numbers(count: usize) -> Vec<f32> {
    (0..count).map(|i| ((i * 7919 % 1013) as f32 - 506.0) / 506.0).collect()
}

fn operations((n_in, n_out, samples): (usize, usize, usize)) -> ItemsCount {
    ItemsCount::new(2 * n_in * n_out * samples)
}

#[divan::bench(args = DENSE)]
fn dense_forward(bencher: Bencher<'_, '_>, shape: (usize, usize, usize)) {
    let (n_in, n_out, samples) = shape;
    let (w, x, mut y) = (numbers(n_in * n_out), numbers(n_in * samples), numbers(n_out * samples));
    let run = || mat::product(&mut y, Accumulate::Replace, &w, &x, (n_out, n_in, samples));
    bencher.counter(operations(shape)).bench_local(run);
}

#[divan::bench(args = DENSE)]
fn dense_backward(bencher: Bencher<'_, '_>, shape: (usize, usize, usize)) {
    let (n_in, n_out, samples) = shape;
    let (w, mut dx, dy) = (numbers(n_in * n_out), numbers(n_in * samples), numbers(n_out * samples));
    let run = || mat::product_transposed(&mut dx, Accumulate::Replace, &w, &dy, (n_out, n_in, samples));
    bencher.counter(operations(shape)).bench_local(run);
}

#[divan::bench(args = DENSE)]
fn dense_gradient(bencher: Bencher<'_, '_>, shape: (usize, usize, usize)) {
    let (n_in, n_out, samples) = shape;
    let (mut dw, x, dy) = (numbers(n_in * n_out), numbers(n_in * samples), numbers(n_out * samples));
    bencher
        .counter(operations(shape))
        .bench_local(|| mat::outer(&mut dw, Accumulate::Replace, &dy, &x, n_out, n_in, 0));
}

/// A convolution of the paper by name: side of the input, channels, resizing.
fn layer(name: &str) -> (usize, [usize; 2], Resize) {
    match name {
        "encoder 2" => (80, [32, 32], Resize::Down(2)),
        "encoder 3" => (40, [32, 32], Resize::Down(2)),
        "encoder 4" => (20, [32, 10], Resize::Down(2)),
        "decoder 1" => (10, [10, 32], Resize::Down(1)),
        "decoder 2" => (10, [32, 32], Resize::Up([2, 2])),
        "decoder 3" => (20, [32, 32], Resize::Up([2, 2])),
        "decoder 4" => (40, [32, 2], Resize::Up([2, 4])),
        _ => unreachable!("no layer {name}"),
    }
}

const LAYERS: [&str; 7] = ["encoder 2", "encoder 3", "encoder 4", "decoder 1", "decoder 2", "decoder 3", "decoder 4"];
const IMAGES: usize = 8;

#[derive(Clone, Copy)]
enum Pass {
    Forward,
    Backward,
    Gradient,
}

/// Counts the work of the convolution by its definition: 25 taps on the upsampled image.
fn convolution(bencher: Bencher<'_, '_>, name: &str, which: Pass) {
    let (side, channels, resize) = layer(name);
    let mut layout = Layout::default();
    let stack = Stack { convs: [Conv::new(&mut layout, "conv", [side; 2], channels, resize, true)] };
    let conv = &stack.convs[0];
    let arena: Vec<f32> = layout.initialize(&mut Rng::seed_from_u64(1));
    let mut packed = stack.packed_weights();
    stack.pack(&arena, &mut packed);
    let mut buffers = StackPass::new(&stack, IMAGES, 1);
    let mut pass = buffers.view(IMAGES);
    let x = numbers(IMAGES * side * side * channels[0]);
    let fill = |i: usize, input: &mut [f32]| conv.fill(&x, i, input);
    stack.forward(&packed, &mut pass, fill);
    let delta = numbers(pass.layers.output().len());
    pass.layers.output_delta().copy_from_slice(&delta);
    let (mut shards, mut gradient) = (stack.shard_sums(), vec![0.0; layout.len]);
    let work = 2 * 25 * IMAGES * conv.pixels() * channels[0];
    bencher.counter(ItemsCount::new(work)).bench_local(|| match which {
        Pass::Forward => stack.forward(&packed, &mut pass, fill),
        Pass::Backward => stack.backward(&packed, &mut pass, Some(|_: usize, d: &[f32]| _ = divan::black_box(d))),
        Pass::Gradient => {
            stack.gradient(1, &mut pass, &mut shards, &mut gradient, &fill);
        }
    });
}

#[divan::bench(args = LAYERS)]
fn convolution_forward(bencher: Bencher<'_, '_>, name: &str) {
    convolution(bencher, name, Pass::Forward);
}

#[divan::bench(args = LAYERS)]
fn convolution_backward(bencher: Bencher<'_, '_>, name: &str) {
    convolution(bencher, name, Pass::Backward);
}

#[divan::bench(args = LAYERS)]
fn convolution_gradient(bencher: Bencher<'_, '_>, name: &str) {
    convolution(bencher, name, Pass::Gradient);
}

/// First layers on images of a bar: pixels, and outputs of the layer.
const FIRST: [(usize, usize); 3] = [(1600, 300), (4608, 500), (12800, 300)];

fn bars(pixels: usize) -> BinaryImages {
    let mut images = BinaryImages::new(&vec![0; pixels]);
    for i in 0..256 {
        let bar = |pixel: usize| u8::from((pixel + 13 * i) % pixels < pixels / 25);
        images.extend(&(0..pixels).map(bar).collect::<Vec<u8>>());
    }
    images
}

#[divan::bench(args = FIRST)]
fn images_forward(bencher: Bencher<'_, '_>, (pixels, n_out): (usize, usize)) {
    let images = bars(pixels);
    let mut layout = Layout::default();
    let layer = layout.linear("first", pixels, n_out);
    let arena: Vec<f32> = layout.initialize(&mut Rng::seed_from_u64(1));
    let (mut base, mut y) = (vec![0.0; n_out], vec![0.0; 256 * n_out]);
    images.base(&layer, &arena, &mut base);
    let (which, rows): (Vec<u32>, _) = ((0..256).collect(), OutputRows { stride: n_out, offset: 0, first_entry: 0 });
    bencher
        .counter(operations((pixels, n_out, 256)))
        .bench_local(|| images.affine(&layer, &arena, &base, &which, &mut y, rows, true));
}

#[divan::bench(args = FIRST)]
fn images_gradient(bencher: Bencher<'_, '_>, (pixels, n_out): (usize, usize)) {
    let images = bars(pixels);
    let mut layout = Layout::default();
    let layer = layout.linear("first", pixels, n_out);
    let (mut gradient, dy) = (vec![0.0; layout.len], numbers(256 * n_out));
    let (which, rows): (Vec<u32>, _) = ((0..256).collect(), OutputRows { stride: n_out, offset: 0, first_entry: 0 });
    bencher
        .counter(operations((pixels, n_out, 256)))
        .bench_local(|| images.gradient(1, &layer, &mut gradient, Accumulate::Replace, &which, &dy, rows));
}

#[divan::bench]
fn bernoulli(bencher: Bencher<'_, '_>) {
    let (images, logits) = (bars(4608), numbers(4608));
    let mut delta = vec![0.0; 4608];
    bencher.counter(ItemsCount::new(4608_usize)).bench_local(|| heads::image(&logits, &images, 3, 0.1, &mut delta));
}

#[divan::bench]
fn adam(bencher: Bencher<'_, '_>) {
    let (count, settings) = (1_316_842, AdamSettings { learning_rate: 5e-4, weight_decay: 1e-3 });
    let (mut adam, mut parameters, gradient) = (Adam::new(count), numbers(count), numbers(count));
    bencher.counter(ItemsCount::new(count)).bench_local(|| adam.step(1, settings, &mut parameters, &gradient));
}
