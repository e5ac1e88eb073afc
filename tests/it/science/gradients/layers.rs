//! Layers, networks and directional derivatives.

use carl_pipe::{
    nn::{
        mat::Accumulate,
        mlp::{Layout, Mlp, Pass},
    },
    num::rng::Rng,
};
use rand::SeedableRng as _;

use super::{H, all, check, dot, random};

#[test]
fn a_layers_gradients_equal_finite_differences() {
    for (n_in, n_out, columns) in [(3, 4, 5), (1, 3, 2), (4, 1, 3), (5, 2, 1)] {
        let mut rng = Rng::seed_from_u64(1);
        let mut layout = Layout::default();
        let layer = layout.linear("layer", n_in, n_out);
        let (arena, x) = (layout.initialize::<f64>(&mut rng), random(&mut rng, n_in * columns));
        let weights = random(&mut rng, n_out * columns);
        let value = |arena: &[f64], x: &[f64]| {
            let mut y = vec![0.0; n_out * columns];
            layer.forward(arena, x, &mut y, false);
            dot(&weights, &y)
        };
        let (mut gradient, mut d_x) = (vec![7.0; layout.len], vec![7.0; x.len()]);
        layer.gradient(1, &mut gradient, Accumulate::Replace, &x, &weights);
        layer.backward(&arena, &weights, &mut d_x);
        check("weights", &arena, &gradient, &all(&arena), |arena| value(arena, &x));
        check("input", &x, &d_x, &all(&x), |x| value(&arena, x));
        let before = gradient.clone();
        layer.gradient(1, &mut gradient, Accumulate::Add, &x, &weights);
        assert!(gradient.iter().zip(&before).all(|(twice, once)| (twice - 2.0 * once).abs() < 1e-12));
    }
}

struct Net {
    net: Mlp<3>,
    arena: Vec<f64>,
    x: Vec<f64>,
    columns: usize,
}

fn net(rng: &mut Rng) -> Net {
    let (n_in, columns) = (3, 4);
    let mut layout = Layout::default();
    let net = layout.mlp("net", n_in, [6, 5, 2]);
    let arena = layout.initialize::<f64>(rng).iter().map(|w| 2.0 * w).collect();
    Net { net, arena, x: random(rng, n_in * columns), columns }
}

#[test]
fn a_networks_gradients_equal_finite_differences() {
    let mut rng = Rng::seed_from_u64(2);
    let Net { net, arena, x, columns } = net(&mut rng);
    let mut pass = Pass::new(&net, columns, 1);
    let mut pass = pass.view(columns);
    let weights = random(&mut rng, 2 * columns);
    let mut value = |arena: &[f64], x: &[f64]| {
        net.forward(arena, x, &mut pass);
        dot(&weights, pass.output())
    };
    let mut own = Pass::new(&net, columns, 1);
    let mut own = own.view(columns);
    net.forward(&arena, &x, &mut own);
    own.output_delta().copy_from_slice(&weights);
    let (mut gradient, mut d_x) = (vec![7.0; arena.len()], vec![7.0; x.len()]);
    net.backward(&arena, &mut own, Some(&mut d_x));
    net.gradient(1, &mut gradient, Accumulate::Replace, &x, &own);
    check("weights", &arena, &gradient, &all(&arena), |arena| value(arena, &x));
    check("input", &x, &d_x, &all(&x), |x| value(&arena, x));
}

#[test]
fn a_directional_derivative_and_its_gradient_equal_finite_differences() {
    let mut rng = Rng::seed_from_u64(3);
    let Net { net, arena, x, columns } = net(&mut rng);
    let direction = random(&mut rng, x.len());
    let weights = random(&mut rng, 2 * columns);
    let run = |arena: &[f64], x: &[f64]| {
        let (mut at, mut pass) = (Pass::new(&net, columns, 1), Pass::new(&net, columns, 1));
        net.forward(arena, x, &mut at.view(columns));
        net.tangent(arena, &at.view(columns), &direction, &mut pass.view(columns));
        (at, pass)
    };
    let (mut at, mut pass) = run(&arena, &x);
    let along = |step: f64| {
        let moved: Vec<f64> = x.iter().zip(&direction).map(|(x, d)| x + step * d).collect();
        run(&arena, &moved).0.output().to_vec()
    };
    for ((above, below), tangent) in along(H).iter().zip(along(-H)).zip(pass.output()) {
        assert!(((above - below) / (2.0 * H) - tangent).abs() < 1e-7);
    }
    let (at, mut pass) = (at.view(columns), pass.view(columns));
    pass.output_delta().copy_from_slice(&weights);
    net.tangent_backward(&arena, &at, &mut pass);
    let mut gradient = vec![0.0; arena.len()];
    net.add_tangent_gradient(&mut gradient, &direction, &pass);
    check("weights", &arena, &gradient, &all(&arena), |arena| dot(&weights, run(arena, &x).1.output()));
}
