//! The losses and gradients of an independent double-precision implementation, reproduced by the code that trains.
//!
//! Data: `CARL_GOLDEN` (default `tests/golden`); all sizes are taken from the files.

use std::{collections::BTreeMap, path::PathBuf};

use carl_pipe::{
    lce::{
        BackwardSizes, ImageNetworks, LceModel, PassiveDynamics, Sizes,
        nets::Nets,
        objective::{Batch, Terms, Weights, Workspace},
    },
    nn::binary_images::BinaryImages,
    num::Real,
};

struct Golden(BTreeMap<String, (Vec<usize>, Vec<f64>)>);

impl Golden {
    fn open(file: &str) -> Self {
        let folder = std::env::var_os("CARL_GOLDEN").map_or_else(|| PathBuf::from("tests/golden"), PathBuf::from);
        let path = folder.join(file);
        let mut archive = npyz::npz::NpzArchive::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let names: Vec<String> = archive.array_names().map(str::to_owned).collect();
        let read = |name: String| {
            let array = archive.by_name(&name).expect("readable").expect("there");
            let shape = array.shape().iter().map(|&n| n as usize).collect();
            (name, (shape, array.into_vec::<f64>().expect("float64")))
        };
        Self(names.into_iter().map(read).collect())
    }

    fn get(&self, name: &str) -> &[f64] {
        &self.0.get(name).unwrap_or_else(|| panic!("no array {name}")).1
    }

    fn shape(&self, name: &str) -> &[usize] {
        &self.0.get(name).unwrap_or_else(|| panic!("no array {name}")).0
    }

    fn outputs(&self, layer: &str) -> usize {
        self.shape(&format!("param.{layer}.weight"))[0]
    }

    fn sizes(&self, jacobian_heads: bool) -> Sizes {
        let out = |layer: &str| self.outputs(layer);
        Sizes {
            shades: None,
            jacobian_heads,
            locally_linear: false,
            passive_dynamics: PassiveDynamics::None,
            images: ImageNetworks::Dense,
            pixels: self.shape("x")[1],
            latent: self.shape("eps_ze")[1],
            action: self.shape("u")[1],
            encoder: [out("encoder.net_hidden.0"), out("encoder.net_hidden.2")],
            decoder: [out("decoder.net_hidden.0"), out("decoder.net_hidden.2")],
            dynamics: [out("dynamics.net_hidden.0"), out("dynamics.net_hidden.2")],
            backward: BackwardSizes {
                z: out("backward_dynamics.net_z"),
                u: out("backward_dynamics.net_u"),
                x: out("backward_dynamics.net_x"),
                joint: out("backward_dynamics.net_joint_hidden.0"),
            },
        }
    }

    /// An arena filled from arrays named `prefix` + the other implementation's layer name.
    fn arena(&self, nets: &Nets, prefix: &str) -> Vec<f64> {
        let mut arena = vec![0.0; nets.layout.len];
        for (name, layer) in &nets.layout.layers {
            let mut row = 0;
            for theirs in theirs(name) {
                let (weights, biases) = layer.w_b_mut(&mut arena);
                // Arrays of gradients that are zero throughout are left out of the files.
                if let Some((shape, w)) = self.0.get(&format!("{prefix}{theirs}.weight")) {
                    for (r, c) in (0..shape[0]).flat_map(|r| (0..shape[1]).map(move |c| (r, c))) {
                        weights[c * layer.n_out + row + r] = w[r * shape[1] + c];
                    }
                }
                if let Some((shape, b)) = self.0.get(&format!("{prefix}{theirs}.bias")) {
                    biases[row..row + shape[0]].copy_from_slice(b);
                }
                row += self.outputs(&theirs);
            }
        }
        arena
    }
}

/// The other implementation's names of one of our layers; a Gaussian head is two layers there.
fn theirs(ours: &str) -> Vec<String> {
    let (net, part) = ours.split_once('.').expect("a net and a layer");
    let net = if net == "backward" { "backward_dynamics" } else { net };
    let parts: &[&str] = match (net, part) {
        (_, "0") => &["net_hidden.0"],
        (_, "1") => &["net_hidden.2"],
        ("decoder", "2") => &["net_logits"],
        (_, "2") => &["net_mean", "net_logstd"],
        (_, "slopes") => &["net_A", "net_B"],
        (_, "joint") => &["net_joint_hidden.0"],
        (_, "head") => &["net_joint_mean", "net_joint_logstd"],
        (_, "z") => &["net_z"],
        (_, "u") => &["net_u"],
        (_, "x") => &["net_x"],
        _ => panic!("unknown layer {ours}"),
    };
    parts.iter().map(|part| format!("{net}.{part}")).collect()
}

struct Case<T> {
    model: LceModel<T>,
    images: BinaryImages,
    actions: Vec<T>,
    noise: Vec<T>,
    guidance: Vec<T>,
    pairs: Vec<u32>,
    x: Vec<u32>,
    delta: f64,
}

impl<T: Real> Case<T> {
    fn new(golden: &Golden, amortized: bool) -> Self {
        let real = |values: &[f64]| values.iter().map(|&v| T::of(v)).collect::<Vec<T>>();
        let bytes = |values: &[f64]| values.iter().map(|&v| v as u8).collect::<Vec<u8>>();
        let sizes = golden.sizes(amortized);
        let samples = golden.shape("x")[0];
        let (n, a) = (sizes.latent, sizes.action);
        let mut frames = Vec::new();
        for (x, next) in golden.get("x").chunks(sizes.pixels).zip(golden.get("x_next").chunks(sizes.pixels)) {
            frames.extend(bytes(x));
            frames.extend(bytes(next));
        }
        let mut noise = Vec::new();
        for i in 0..samples {
            for (name, width) in [("eps_znext", n), ("eps_zq", n), ("eps_ze", n), ("eps_cur_z", n), ("eps_cur_u", a)] {
                noise.extend(real(&golden.get(name)[i * width..(i + 1) * width]));
            }
        }
        let background = carl_pipe::lce::model::background(&frames, sizes.pixels);
        let nets = Nets::new(&sizes);
        let arena = real(&golden.arena(&nets, "param."));
        let model = LceModel { sizes, nets, arena, background };
        let images = model.pictures(&frames);
        Self {
            model,
            images,
            actions: real(golden.get("u")),
            noise,
            guidance: real(golden.get("w")),
            pairs: (0..2 * samples as u32).collect(),
            x: (0..samples as u32).map(|i| 2 * i).collect(),
            delta: golden.get("delta")[0],
        }
    }

    fn run(&self, weights: &Weights, guided: bool) -> (Terms, Vec<f64>, Vec<Terms>) {
        let mut workspace = Workspace::new(&self.model, self.x.len());
        let batch = Batch {
            images: &self.images,
            pairs: &self.pairs,
            x: &self.x,
            actions: &self.actions,
            noise: &self.noise,
            curvature_sigma: self.delta,
            anchor_scale: 1.0,
            guidance: guided.then_some(&self.guidance),
            regularizer: None,
        };
        let terms = workspace.step(2, &self.model, weights, &batch);
        let gradient = workspace.gradient().iter().map(|g| g.f64()).collect();
        (terms, gradient, (0..self.x.len()).map(|i| workspace.sample_terms(i)).collect())
    }
}

fn none() -> Weights {
    Weights::default()
}

/// Totals and single terms of the files as weights of ours, and whether samples are weighted.
fn objectives() -> Vec<(&'static str, Weights, bool)> {
    let carl = Weights {
        reconstruction: 1.0,
        consistency: 8.0,
        curvature: 1.0,
        encode_decode: 0.01,
        deterministic: 0.3,
        ..none()
    };
    vec![
        ("grad.carl.", carl, false),
        ("grad.vcarl.", carl, true),
        ("grad.pcc_paper_1_7_1.", Weights { prior: 0.01, ..carl }, false),
        ("grad.ae_true.", Weights { encode_decode: 1.0, ..none() }, false),
        ("gterm.recon_next.", Weights { reconstruction: 1.0, ..none() }, false),
        ("gterm.cons.", Weights { consistency: 1.0, ..none() }, false),
        ("gterm.pred.", Weights { reconstruction: 1.0, consistency: 1.0, ..none() }, false),
        ("gterm.determ.", Weights { deterministic: 1.0, ..none() }, false),
        ("gterm.recon_ze.", Weights { encode_decode: 1.0, ..none() }, false),
        ("gterm.kl_prior.", Weights { prior: 1.0, ..none() }, false),
        ("gterm.cur_jvp_ze.", Weights { curvature: 1.0, ..none() }, false),
    ]
}

fn check<T: Real>(file: &str, value_tolerance: f64, gradient_tolerance: f64) {
    let golden = Golden::open(file);
    for amortized in [false, true] {
        if !amortized || golden.0.contains_key("param.dynamics.net_A.weight") {
            check_with::<T>(&golden, amortized, file, value_tolerance, gradient_tolerance);
        }
    }
}

/// Reads one term of a loss.
type Term = fn(&Terms) -> f64;

/// Without and with heads for the Jacobians of F.
fn check_with<T: Real>(golden: &Golden, amortized: bool, file: &str, value_tolerance: f64, gradient_tolerance: f64) {
    let case = Case::<T>::new(golden, amortized);
    // In the amortized file the totals take the curvature from heads for the Jacobians.
    let amortized_file = golden.0.contains_key("param.dynamics.net_A.weight");
    for (prefix, weights, guided) in objectives() {
        if amortized_file && !amortized && weights.curvature != 0.0 && prefix.starts_with("grad.") {
            continue;
        }
        let prefix = if amortized { prefix.replace("cur_jvp_ze", "cur_ampaper_ze") } else { prefix.to_owned() };
        let (terms, gradient, _) = case.run(&weights, guided);
        let want = golden.arena(&case.model.nets, &prefix);
        let largest = want.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
        for (i, (got, want)) in gradient.iter().zip(&want).enumerate() {
            let error = (got - want).abs() / largest;
            assert!(error <= gradient_tolerance, "{file}: {prefix} entry {i}: {got} is not {want}");
        }
        if let Some(total) = prefix.strip_prefix("grad.").filter(|_| !guided) {
            let want = golden.get(&format!("total.{}", total.trim_end_matches('.')))[0];
            let got = terms.total(&weights);
            assert!(((got - want) / want).abs() <= value_tolerance, "{file}: {total}: {got} is not {want}");
        }
    }
    let (_, _, samples) = case.run(&objectives()[0].1, false);
    let curvature = if amortized { "cur_ampaper_ze" } else { "cur_jvp_ze" };
    let terms: [(&str, Term); 8] = [
        ("recon_next", |terms| terms.reconstruction),
        ("kl_back", |terms| terms.kl_backward),
        ("ent_next", |terms| terms.entropy),
        ("logp_next", |terms| terms.log_density),
        (curvature, |terms| terms.curvature),
        ("recon_ze", |terms| terms.encode_decode),
        ("kl_prior", |terms| terms.prior),
        ("determ", |terms| terms.deterministic),
    ];
    for (name, term) in terms {
        let want = golden.get(&format!("term.{name}"));
        let largest = want.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
        for (i, (sample, want)) in samples.iter().zip(want).enumerate() {
            let error = (term(sample) - want).abs() / largest;
            assert!(error <= value_tolerance, "{file}: {name} of sample {i}: {} is not {want}", term(sample));
        }
    }
}

#[test]
fn golden_losses_nonamortized_in_double_precision() {
    check::<f64>("losses_nonamortized.npz", 1e-11, 1e-10);
}

#[test]
fn golden_losses_amortized_in_double_precision() {
    check::<f64>("losses_amortized.npz", 1e-11, 1e-10);
}

#[test]
fn golden_losses_nonamortized_in_production_precision() {
    check::<f32>("losses_nonamortized.npz", 1e-5, 1e-4);
}

#[test]
fn golden_losses_amortized_in_production_precision() {
    check::<f32>("losses_amortized.npz", 1e-5, 1e-4);
}
