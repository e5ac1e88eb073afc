//! Refits F alone to fixed codes.
//!
//! While all networks train together, codes move and other terms pull on F, so F lags behind. Control uses the model
//! through F only, so it pays to fit F to the final codes.

use super::{
    dynamics::{Dynamics, DynamicsColumns, DynamicsPass},
    model::LceModel,
    trainer::BATCH,
};
use crate::{
    nn::{
        adam::{Adam, AdamSettings},
        heads,
        mat::Accumulate,
    },
    num::{rng::Rng, sampling, simd::vectorize},
};

/// Minimises -ln F(E(x')|E(x), u), with the means of E, over `steps` random batches. Only F changes.
///
/// `codes` holds E(·|x) and E(·|x') of every transition in turn, `actions` one column for every transition. The step
/// size falls linearly from `learning_rate` to zero.
///
/// # Errors
/// The number of the first step after which a parameter of F is not finite.
pub fn refit(
    model: &mut LceModel,
    codes: &[f32],
    actions: &[f32],
    steps: u64,
    learning_rate: f64,
    rng: &mut Rng,
) -> Result<(), u64> {
    let count = actions.len() / model.sizes.action;
    let draw = |rng: &mut Rng| sampling::index(rng, count);
    fit(&model.nets.dynamics, &mut model.arena, (codes, actions), count, (steps, learning_rate), draw, rng)
}

/// Fits `net`, which stands for F and has its parameters in `arena`, to `count` transitions as [`refit`] does. `draw` draws
/// the transitions of a batch.
pub(super) fn fit(
    net: &Dynamics,
    arena: &mut [f32],
    (codes, actions): (&[f32], &[f32]),
    count: usize,
    (steps, learning_rate): (u64, f64),
    draw: impl Fn(&mut Rng) -> usize,
    rng: &mut Rng,
) -> Result<(), u64> {
    let (n, a) = (codes.len() / (4 * count), actions.len() / count);
    let parameters = net.parameters();
    let mut adam = Adam::new(parameters.len());
    let mut gradient = vec![0.0; arena.len()];
    let mut pass = DynamicsPass::new(net, BATCH, 1);
    let (mut z_u, mut moves) = (vec![0.0; BATCH * (n + a)], vec![0.0; BATCH * n]);
    let mut d_moves = vec![0.0; n];
    for step in 0..steps {
        for (z_u, moves) in z_u.chunks_exact_mut(n + a).zip(moves.chunks_exact_mut(n)) {
            let which = draw(rng);
            let (now, next) = codes[4 * n * which..][..4 * n].split_at(2 * n);
            z_u[..n].copy_from_slice(&now[..n]);
            z_u[n..].copy_from_slice(&actions[which * a..][..a]);
            for k in 0..n {
                moves[k] = next[k] - now[k];
            }
        }
        let mut pass = pass.view(BATCH);
        density_gradient(net, arena, (&z_u, &moves), &mut d_moves, &mut pass);
        net.gradient(&mut gradient, Accumulate::Replace, &z_u, &pass);
        let learning_rate_scale = 1.0 - step as f64 / steps as f64;
        let settings = AdamSettings { learning_rate: learning_rate * learning_rate_scale, weight_decay: 0.0 };
        if !adam.step(1, settings, &mut arena[parameters.clone()], &gradient[parameters.clone()]) {
            return Err(step);
        }
    }
    Ok(())
}

/// The deltas of F for the mean of -ln F(z'|z, u), where `moves` are z' - z. `d_moves` is a buffer of one code.
fn density_gradient(
    net: &Dynamics,
    arena: &[f32],
    (z_u, moves): (&[f32], &[f32]),
    d_moves: &mut [f32],
    pass: &mut DynamicsColumns<'_, f32>,
) {
    let n = d_moves.len();
    vectorize(
        #[inline(always)]
        || {
            net.forward(arena, z_u, pass);
            let (gaussians, deltas) = pass.output_and_delta();
            deltas.fill(0.0);
            let columns = gaussians.chunks_exact(2 * n).zip(deltas.chunks_exact_mut(2 * n));
            for ((gaussian, delta), moves) in columns.zip(moves.chunks_exact(n)) {
                heads::log_density(moves, gaussian, -1.0 / BATCH as f32, d_moves, delta);
            }
            net.backward(arena, z_u, pass, None);
        },
    );
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::lce::Sizes;

    #[test]
    fn a_refitted_f_predicts_the_next_codes_and_nothing_else_changes() {
        let mut rng = Rng::seed_from_u64(5);
        let sizes = Sizes { pixels: 4, encoder: [3, 3], decoder: [3, 3], ..Sizes::planar() };
        let mut model = LceModel::<f32>::new(sizes, vec![0; 4], &mut rng);
        let before = model.clone();
        // z' = z + (u_1 + z_2 / 2, u_2 / 2), without noise.
        let count = 500;
        let mut codes = vec![0.0; count * 8];
        let mut actions = vec![0.0; count * 2];
        for (code, u) in codes.chunks_exact_mut(8).zip(actions.chunks_exact_mut(2)) {
            code[..2].fill_with(|| sampling::uniform(&mut rng, -2.0, 2.0));
            u.fill_with(|| sampling::uniform(&mut rng, -1.0, 1.0));
            (code[4], code[5]) = (code[0] + u[0] + 0.5 * code[1], code[1] + 0.5 * u[1]);
        }
        refit(&mut model, &codes, &actions, 1500, 5e-3, &mut rng).unwrap();

        let z: Vec<f32> = codes.chunks_exact(8).flat_map(|code| &code[..2]).copied().collect();
        let predicted = model.predict_mean(&z, &actions);
        let errors = predicted.chunks(2).zip(codes.chunks(8)).flat_map(|(z, code)| [z[0] - code[4], z[1] - code[5]]);
        let rms = (errors.map(|e| e * e).sum::<f32>() / (2 * count) as f32).sqrt();
        assert!(rms < 0.05, "{rms}");
        let changed = (0..model.arena.len()).filter(|&i| model.arena[i] != before.arena[i]);
        let parameters = model.nets.dynamics.parameters();
        assert!(changed.into_iter().all(|i| parameters.contains(&i)));
    }
}
