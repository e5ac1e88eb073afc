//! First layers on binary images against dense layers.

use rand::SeedableRng as _;

use super::*;
use crate::nn::{
    mat::Accumulate,
    mlp::{Layout, Pass},
};

#[test]
fn differences_give_the_dense_product_and_its_gradient() {
    let mut rng = Rng::seed_from_u64(3);
    let (pixels, n_out, count) = (37, 5, 11);
    let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 4) == 0)).collect();
    let mut images = BinaryImages::new(&frames[..pixels]);
    images.extend(&frames);
    let mut layout = Layout::default();
    let layer = layout.linear("first", pixels, n_out);
    let arena: Vec<f64> = layout.initialize(&mut rng);
    let which: Vec<u32> = (0..count as u32).rev().collect();
    let x: Vec<f64> = which.iter().flat_map(|&i| &frames[i as usize * pixels..][..pixels]).map(|&p| p.into()).collect();
    let rows = OutputRows { stride: n_out + 3, offset: 2, first_entry: 0 };

    let (mut base, mut dense) = (vec![0.0; n_out], vec![0.0; n_out * count]);
    let mut sparse = vec![0.0; rows.stride * count];
    images.base(&layer, &arena, &mut base);
    images.affine(&layer, &arena, &base, &which, &mut sparse, rows, true);
    layer.forward(&arena, &x, &mut dense, true);
    for (dense, sparse) in dense.chunks(n_out).zip(sparse.chunks(rows.stride)) {
        assert!(dense.iter().zip(&sparse[2..]).all(|(a, b)| (a - b).abs() < 1e-14));
    }

    let dy: Vec<f64> = sparse.iter().enumerate().map(|(i, _)| (i as f64).sin()).collect();
    let dense_dy: Vec<f64> = dy.chunks(rows.stride).flat_map(|dy| &dy[2..2 + n_out]).copied().collect();
    let [mut want, mut one, mut two] = [(); 3].map(|()| vec![0.0; layout.len]);
    layer.gradient(1, &mut want, Accumulate::Replace, &x, &dense_dy);
    images.gradient(1, &layer, &mut one, Accumulate::Replace, &which, &dy, rows);
    images.gradient(2, &layer, &mut two, Accumulate::Replace, &which, &dy, rows);
    assert!(want.iter().zip(&one).all(|(a, b)| (a - b).abs() < 1e-13));
    assert_eq!(one, two);
    assert_eq!(images.lit(3).count(), frames[3 * pixels..4 * pixels].iter().filter(|&&p| p != 0).count());
}

/// Asserts that a first layer of `n_out` units gives what a dense layer on `x` gives: the inputs of all images in turn.
fn gives_the_dense_product_and_its_gradient(images: &BinaryImages, x: &[f64], n_out: usize, rng: &mut Rng) {
    let count = images.len();
    let mut layout = Layout::default();
    let layer = layout.linear("first", x.len() / count, n_out);
    let arena: Vec<f64> = layout.initialize(rng);
    let which: Vec<u32> = (0..count as u32).collect();
    let rows = OutputRows { stride: n_out, offset: 0, first_entry: 0 };
    let (mut base, mut dense, mut sparse) = (vec![0.0; n_out], vec![0.0; n_out * count], vec![0.0; n_out * count]);
    images.base(&layer, &arena, &mut base);
    images.affine(&layer, &arena, &base, &which, &mut sparse, rows, false);
    layer.forward(&arena, x, &mut dense, false);
    assert!(dense.iter().zip(&sparse).all(|(a, b)| (a - b).abs() < 1e-14));

    let dy: Vec<f64> = (0..n_out * count).map(|i| (i as f64).sin()).collect();
    let [mut want, mut one, mut two] = [(); 3].map(|()| vec![0.0; layout.len]);
    layer.gradient(1, &mut want, Accumulate::Replace, x, &dy);
    images.gradient(1, &layer, &mut one, Accumulate::Replace, &which, &dy, rows);
    images.gradient(2, &layer, &mut two, Accumulate::Replace, &which, &dy, rows);
    assert!(want.iter().zip(&one).all(|(a, b)| (a - b).abs() < 1e-13));
    assert_eq!(one, two);
}

#[test]
fn patches_are_read_as_the_share_of_their_pixels_that_is_lit() {
    let mut rng = Rng::seed_from_u64(4);
    let (patches, pixels, n_out, count) = (PooledPatches { columns: 12, side: 3 }, 6 * 12, 5, 7);
    let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
    let mut images = BinaryImages::pooled(pixels, patches, patches);
    images.extend(&frames);
    let share = |image: usize, patch: usize| {
        let (top, left) = (patch / 4 * 3, patch % 4 * 3);
        let rows = (0..3).map(|row| image * pixels + (top + row) * 12 + left);
        rows.map(|at| frames[at..at + 3].iter().map(|&p| f64::from(p)).sum::<f64>()).sum::<f64>() / 9.0
    };
    let x: Vec<f64> = (0..count * 8).map(|i| share(i / 8, i % 8)).collect();
    for (image, x) in x.chunks(8).enumerate() {
        for (patch, lit) in images.lit(image as u32) {
            assert_eq!(lit, (9.0 * x[patch]).round());
        }
    }

    gives_the_dense_product_and_its_gradient(&images, &x, n_out, &mut rng);
}

#[test]
fn thinned_patches_are_read_right_on_average_and_decoded_whole() {
    let mut rng = Rng::seed_from_u64(6);
    let (patches, pixels, count) = (PooledPatches { columns: 4, side: 2 }, 16, 3);
    let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 2) == 0)).collect();
    let mut images = BinaryImages::pooled(pixels, patches, patches);
    images.extend(&frames);
    let mut layout = Layout::default();
    let layer = layout.linear("first", 4, 2);
    let arena: Vec<f64> = layout.initialize(&mut rng);
    let read = |images: &BinaryImages, which: &[u32]| {
        let (mut base, mut y) = (vec![0.0; 2], vec![0.0; 2 * which.len()]);
        images.base(&layer, &arena, &mut base);
        images.affine(&layer, &arena, &base, which, &mut y, OutputRows { stride: 2, offset: 0, first_entry: 0 }, false);
        y
    };
    let whole = read(&images, &[2, 0]);
    let (mut mean, draws) = (vec![0.0; 4], 4000);
    for _ in 0..draws {
        let thinned = images.with_dropout(&[2, 0], 0.25, &mut rng);
        assert!(thinned.lit(0).eq(images.lit(2)) && thinned.lit(1).eq(images.lit(0)));
        let y = read(&thinned, &[0, 1]);
        mean.iter_mut().zip(y).for_each(|(mean, y)| *mean += y / f64::from(draws));
    }
    assert!(mean.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 0.03), "{mean:?} {whole:?}");
    assert_ne!(read(&images.with_dropout(&[2, 0], 0.25, &mut rng), &[0, 1]), whole);
}

#[test]
fn a_layer_that_reads_single_frames_gives_the_dense_product_of_each_and_adds_their_gradients() {
    let mut rng = Rng::seed_from_u64(7);
    let (patches, pixels, count) = (PooledPatches { columns: 4, side: 1 }, 4 * 4, 5);
    let frames: Vec<u8> = (0..pixels * count).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
    let mut images = BinaryImages::pooled(pixels, patches, patches);
    images.extend(&frames);
    let mut layout = Layout::default();
    let net = layout.mlp("frame", pixels / 2, [5, 3]);
    let arena: Vec<f64> = layout.initialize(&mut rng);
    let which: Vec<u32> = (0..count as u32).collect();
    let x: Vec<f64> = frames.iter().map(|&p| p.into()).collect();
    let [mut dense, mut sparse] = [(); 2].map(|()| Pass::new(&net, count, 2));
    let (mut dense, mut sparse) = (dense.view(count), sparse.view(count));

    net.forward(&arena, &x, &mut dense);
    net.forward_on_images(&arena, net.layers[0].b(&arena), (&images, &which), &mut sparse);
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-13);
    assert!(close(dense.output(), sparse.output()));

    for pass in [&mut dense, &mut sparse] {
        pass.output_delta().iter_mut().enumerate().for_each(|(i, d)| *d = (i as f64).cos());
        net.backward(&arena, pass, None);
    }
    let [mut want, mut got] = [(); 2].map(|()| vec![0.0; layout.len]);
    net.gradient(1, &mut want, Accumulate::Replace, &x, &dense);
    net.gradient_on_images(2, &mut got, (&images, &which), &sparse);
    assert!(close(&want, &got));
}

#[test]
fn larger_patches_are_predicted_from_the_lit_pixels_of_the_smaller_ones_that_are_read() {
    let mut rng = Rng::seed_from_u64(8);
    let [small, large] = [2, 4].map(|side| PooledPatches { columns: 12, side });
    let pixels = 8 * 12;
    let frame: Vec<u8> = (0..pixels).map(|_| u8::from(sampling::index(&mut rng, 2) == 0)).collect();
    let [mut mixed, mut whole] = [small, large].map(|read| BinaryImages::pooled(pixels, read, large));
    let counts = |images: &mut BinaryImages| {
        images.extend(&frame);
        let mut counts = vec![0.0; pixels / large.area()];
        images.lit(0).for_each(|(patch, count)| counts[patch] += count);
        counts
    };
    assert_eq!(counts(&mut mixed), counts(&mut whole));
    assert_eq!(mixed.predicted_area(), 16);
}

/// Half of the pixels are black, the others have any shade.
fn shades(count: usize, rng: &mut Rng) -> Vec<u8> {
    (0..count).map(|_| sampling::index(rng, 2) as u8 * sampling::index(rng, 256) as u8).collect()
}

#[test]
fn shades_give_the_dense_product_and_its_gradient() {
    let mut rng = Rng::seed_from_u64(9);
    let (pixels, n_out, count) = (37, 5, 11);
    let frames = shades(pixels * count, &mut rng);
    let mut images = BinaryImages::shaded(&frames[..pixels], Likelihood::Bernoulli);
    images.extend(&frames);
    let x: Vec<f64> = frames.iter().map(|&byte| f64::from(byte) / 255.0).collect();
    gives_the_dense_product_and_its_gradient(&images, &x, n_out, &mut rng);

    for (image, x) in (0..).zip(x.chunks(pixels)) {
        let mut target = vec![0.0; pixels];
        images.lit(image).for_each(|(pixel, shade)| target[pixel] += shade);
        assert_eq!(target, x);
    }
}

#[test]
fn patches_with_shades_are_read_as_their_mean_to_the_nearest_byte() {
    let mut rng = Rng::seed_from_u64(10);
    let patches = PooledPatches { columns: 6, side: 2 };
    let frame = shades(4 * 6, &mut rng);
    let mut images = BinaryImages::pooled(4 * 6, patches, patches).with_shades(Likelihood::Bernoulli);
    images.extend(&frame);
    let mut sums = vec![0.0; 6];
    frame.iter().enumerate().for_each(|(pixel, &byte)| sums[patches.around(pixel)] += f64::from(byte) / 255.0);
    images.lit(0).for_each(|(patch, sum)| sums[patch] -= sum);
    assert!(sums.iter().all(|rest| rest.abs() <= 4.0 * 0.5 / 255.0 + 1e-12), "{sums:?}");
}

#[test]
fn black_and_white_pictures_with_shades_are_those_without() {
    let mut rng = Rng::seed_from_u64(11);
    let frames: Vec<u8> = (0..5 * 24).map(|_| sampling::index(&mut rng, 2) as u8 * 255).collect();
    let patches = PooledPatches { columns: 6, side: 2 };
    let pooled = || BinaryImages::pooled(24, patches, patches);
    let (reference, likelihood) = (&frames[..24], Likelihood::Bernoulli);
    for (mut without, mut with) in [
        (BinaryImages::new(reference), BinaryImages::shaded(reference, likelihood)),
        (pooled(), pooled().with_shades(likelihood)),
    ] {
        without.extend(&frames);
        with.extend(&frames);
        assert_eq!(BinaryImages { shades: None, ..with }, without);
    }
}
