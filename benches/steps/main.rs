//! Times whole training steps and single decisions: milliseconds, GFLOP/s, and per cent of the peak that this process
//! measures itself.
//!
//!   cargo bench --bench steps                          every work, one thread and two
//!   cargo bench --bench steps -- planar sac            some
//!   cargo bench --bench steps -- serve --work planar --threads 2
//!
//! `serve` takes `run N` on its standard input and answers each with the milliseconds of N steps, so that
//! `benches/peers/compare` can take turns with a peer. Work is counted as the dense, unfolded networks have it, whatever
//! is left out here.

#![allow(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

mod peak;
mod work;

use std::{
    io::{BufRead as _, Write as _},
    time::Instant,
};

use serde_json::json;
use work::{Work, median};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| arg != "--bench").collect();
    if args.first().is_some_and(|arg| arg == "serve") {
        let value = |flag: &str| args.iter().skip_while(|arg| *arg != flag).nth(1).cloned();
        let threads = value("--threads").map_or(1, |n| n.parse().expect("--threads takes a number"));
        return serve(&value("--work").expect("serve needs --work"), threads);
    }
    println!("peak of one thread {:.0} GFLOP/s", peak::gflops());
    println!("{:<11} {:>7} {:>10} {:>9} {:>7}", "work", "threads", "ms", "GFLOP/s", "share");
    for name in work::NAMES.iter().filter(|name| args.is_empty() || args.iter().any(|arg| arg == *name)) {
        for threads in [1, 2] {
            pool(threads).install(|| {
                let mut work = Work::new(name, threads);
                let peak = peak::gflops();
                let ms = median(&times(&mut work, 3, usize::MAX)[1..]);
                let rate = work.gflop() / ms * 1e3;
                let share = 100.0 * rate / peak / threads as f64;
                println!("{name:<11} {threads:>7} {ms:>10.3} {rate:>9.1} {share:>6.1}%");
            });
        }
    }
}

/// Milliseconds of steps: up to `most`, for at least a second or `least` steps.
fn times(work: &mut Work, least: usize, most: usize) -> Vec<f64> {
    let begin = Instant::now();
    let mut all = Vec::new();
    while all.len() < most && (all.len() < least || begin.elapsed().as_secs_f64() < 1.0) {
        let start = Instant::now();
        work.step();
        all.push(start.elapsed().as_secs_f64() * 1e3);
    }
    all
}

/// Threads of our own, so that `threads` means as many and no more.
fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

fn serve(name: &str, threads: usize) {
    pool(threads).install(|| {
        let mut work = Work::new(name, threads);
        work.step();
        let about = json!({
            "ready": true,
            "peer": "carl-pipe",
            "work": name,
            "threads": threads,
            "gflop_per_step": work.gflop(),
            "peak_gflops": peak::gflops(),
        });
        println!("{about}");
        for line in std::io::stdin().lock().lines() {
            let line = line.expect("a line");
            let Some(count) = line.strip_prefix("run ") else { break };
            let steps = count.trim().parse().expect("run N");
            let ms: Vec<f64> = (0..steps)
                .map(|_| {
                    let start = Instant::now();
                    work.step();
                    start.elapsed().as_secs_f64() * 1e3
                })
                .collect();
            println!("{}", json!({ "ms": ms }));
            std::io::stdout().flush().expect("standard output");
        }
    });
}
