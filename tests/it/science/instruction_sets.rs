//! The kernels behind faer's products give the same bits on AVX2 and on AVX-512.
//!
//! faer takes the widest that a machine has and offers no choice, so its kernels are called directly here. Our own are
//! held against each other where they are (`on_every_instruction_set`).

#![allow(unsafe_code, reason = "the kernels take pointers")]
#![cfg(target_arch = "x86_64")]

use carl_pipe::num::{rng::Rng, sampling};
use private_gemm_x86::{Accum, DType, DstKind, IType, InstrSet, gemm};
use rand::SeedableRng as _;

/// w \[m, k\] x \[k, n\], or wᵀ \[m, k\] x with w \[k, m\], all column-major.
fn product(
    instructions: InstrSet,
    w: &[f32],
    x: &[f32],
    (m, k, n): (usize, usize, usize),
    transposed: bool,
) -> Vec<u32> {
    let mut out = vec![0.0_f32; m * n];
    let (rows, columns) = if transposed { (k as isize, 1) } else { (1, m as isize) };
    // SAFETY: every slice has as many entries as its shape and strides reach; nothing is indexed or conjugated, and
    // this machine has the instruction set (checked by the caller).
    unsafe {
        gemm(
            DType::F32,
            IType::U64,
            instructions,
            m,
            n,
            k,
            out.as_mut_ptr().cast(),
            1,
            m as isize,
            std::ptr::null(),
            std::ptr::null(),
            DstKind::Full,
            Accum::Replace,
            w.as_ptr().cast(),
            rows,
            columns,
            false,
            std::ptr::null(),
            0,
            x.as_ptr().cast(),
            1,
            k as isize,
            false,
            (&raw const ONE).cast(),
            1,
        );
    }
    out.iter().map(|y| y.to_bits()).collect()
}

static ONE: f32 = 1.0;

#[test]
fn products_have_the_same_bits_on_avx2_and_avx512() {
    if !is_x86_feature_detected!("avx512f") {
        println!("no AVX-512 here: nothing to compare");
        return;
    }
    let mut rng = Rng::seed_from_u64(1);
    for shape @ (m, k, n) in [
        (300, 1600, 96),
        (1600, 300, 128),
        (300, 300, 256),
        (20, 4, 640),
        (256, 256, 128),
        (4, 300, 128),
        (33, 1100, 7),
    ] {
        let mut random =
            |count: usize| (0..count).map(|_| sampling::uniform(&mut rng, -1.0, 1.0)).collect::<Vec<f32>>();
        let (w, x) = (random(m * k), random(k * n));
        for transposed in [false, true] {
            let [wide, narrow] = [InstrSet::Avx512, InstrSet::Avx256].map(|i| product(i, &w, &x, shape, transposed));
            assert!(wide == narrow, "{shape:?}");
        }
    }
}
