//! The CARL training step of the planar system in burn, for `compare`: what `torch_peer.py` does, with burn's fastest
//! back end for processors.
//!
//! `burn-peer serve --work planar --threads 1` prints one JSON line when it is ready, answers every line `run N` on
//! standard input with one JSON line `{"ms": [milliseconds of each of N steps]}`, and ends at `quit`.
//! `burn-peer check` takes 200 steps and fails unless losses stay finite and fall.

mod data;
mod model;
mod sizes;

use std::{
    io::{BufRead as _, Write as _},
    process::ExitCode,
    time::Instant,
};

use burn::{
    optim::{AdamConfig, GradientsParams, ModuleOptimizer, decay::WeightDecayConfig},
    tensor::{Device, Distribution, Tensor},
};
use model::Carl;
use sizes::{ACTION, BATCH, LATENT};

struct Step {
    device: Device,
    model: Carl,
    adam: ModuleOptimizer,
    batches: Vec<data::Batch>,
    steps: usize,
}

impl Step {
    fn new() -> Self {
        let device = Device::flex().autodiff();
        device.seed(0);
        let adam =
            AdamConfig::new().with_epsilon(1e-8).with_weight_decay(Some(WeightDecayConfig { penalty: 1e-3 })).init();
        Self { model: Carl::new(&device), adam, batches: data::batches(&device), device, steps: 0 }
    }

    /// One training step. Gives the loss, unread: to read it takes a copy.
    fn run(&mut self) -> Tensor<1> {
        let batch = &self.batches[self.steps % self.batches.len()];
        self.steps += 1;
        let noise = Tensor::random([BATCH, 4 * LATENT + ACTION], Distribution::Normal(0.0, 1.0), &self.device);
        let loss = self.model.loss(batch, noise);
        let gradients = GradientsParams::from_grads(loss.backward(), &self.model);
        self.model = self.adam.step(5e-4, self.model.clone(), gradients);
        loss.detach()
    }
}

fn serve() {
    let mut step = Step::new();
    for _ in 0..3 {
        step.run();
    }
    say(&serde_json::json!({ "ready": true, "peer": "burn", "version": "0.22.1", "variant": "default" }));
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("standard input can be read");
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["run", count] => {
                let count: usize = count.parse().expect("`run` is followed by a number");
                let milliseconds: Vec<f64> = (0..count)
                    .map(|_| {
                        let start = Instant::now();
                        step.run();
                        start.elapsed().as_secs_f64() * 1000.0
                    })
                    .collect();
                say(&serde_json::json!({ "ms": milliseconds }));
            }
            ["quit"] => return,
            _ => panic!("unknown request `{line}`"),
        }
    }
}

fn check() -> bool {
    let mut step = Step::new();
    let losses: Vec<f32> = (0..200).map(|_| step.run().into_scalar::<f32>()).collect();
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let (first, last) = (mean(&losses[..20]), mean(&losses[180..]));
    say(&serde_json::json!({ "work": "planar", "first": first, "last": last }));
    losses.iter().all(|loss| loss.is_finite()) && last < first
}

fn say(line: &serde_json::Value) {
    println!("{line}");
    std::io::stdout().flush().expect("standard output can be written");
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|i| arguments.get(i + 1));
    let threads = value("--threads").map_or(1, |threads| threads.parse().expect("`--threads` takes a number"));
    if value("--work").is_some_and(|work| work != "planar") {
        eprintln!("burn-peer: the only work is planar");
        return ExitCode::from(2);
    }
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().expect("the pool is built once");
    match arguments.first().map(String::as_str) {
        Some("serve") => serve(),
        Some("check") if check() => {}
        Some("check") => return ExitCode::FAILURE,
        _ => {
            eprintln!("usage: burn-peer serve|check [--work planar] [--threads N]");
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}
