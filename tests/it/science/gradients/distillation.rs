//! Policy distillation.

use carl_pipe::{
    control::{Agent, distill},
    nn::{adam::Adam, mlp::Pass},
    num::rng::Rng,
};
use rand::SeedableRng as _;

use super::random;

/// A student and a teacher in single precision: differences along the gradient, over all parameters and by layer.
#[test]
fn the_gradient_of_distillation_equals_finite_differences() {
    let mut rng = Rng::seed_from_u64(8);
    let samples = 16;
    let new = |rng: &mut Rng| Agent::new(2, 2, None, 0.0, rng);
    let (teacher, mut student) = (new(&mut rng), new(&mut rng));
    let inputs: Vec<f32> = random(&mut rng, 4 * samples).iter().map(|&x| x as f32).collect();
    let targets = teacher.gaussians(&teacher.actor.arena, &inputs);
    let mut pass = Pass::new(&student.nets.actor.mlp, samples, 1);
    let mut gradient = vec![0.0; student.actor.arena.len()];
    let mut adam = Adam::new(gradient.len());
    let mut kl = |arena: &[f32], rate: f64, gradient: &mut [f32]| {
        student.actor.arena.copy_from_slice(arena);
        let (kl, _) = distill::step(&mut student, &mut adam, rate, &mut pass, gradient, (&inputs, &targets));
        (kl, student.actor.arena.clone())
    };
    let start = new(&mut rng).actor.arena;
    let layers = teacher.nets.actor.layout.layers.clone();
    let value = kl(&start, 0.0, &mut gradient).0;
    let whole = (0, start.len());
    for (at, len) in layers.iter().map(|(_, layer)| (layer.at, layer.len())).chain([whole]) {
        let part = &gradient[at..at + len];
        let norm = part.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
        let [above, below] = [2e-2, -2e-2].map(|step| {
            let mut moved = start.clone();
            for (p, &g) in moved[at..at + len].iter_mut().zip(part) {
                *p += (step * f64::from(g) / norm) as f32;
            }
            kl(&moved, 0.0, &mut vec![0.0; start.len()]).0
        });
        let slope = (above - below) / 4e-2;
        assert!((slope - norm).abs() < 0.02 * norm, "{at}: the gradient says {norm}, differences say {slope}");
    }
    let mut moving = start;
    for _ in 0..100 {
        moving = kl(&moving, 1e-3, &mut gradient).1;
    }
    let after = kl(&moving, 0.0, &mut gradient).0;
    assert!(after < 0.1 * value, "KL {value} -> {after}");
    assert!(kl(&teacher.actor.arena, 0.0, &mut gradient).0.abs() < 1e-6, "the teacher has nothing to learn");
    assert!(gradient.iter().all(|g| g.abs() < 1e-5));
}
