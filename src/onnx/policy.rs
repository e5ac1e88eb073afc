//! The policy as a graph: a = tanh(pi(w(E(x)), w(E(x_g)))), where E gives means of codes and w whitens them.

use anyhow::{Context as _, ensure};
use prost::Message as _;

use super::{
    graph::{Builder, Value, number, numbers},
    wire::{FLOAT, Model, OperatorSet, Property, UINT8},
};
use crate::{
    control::{Agent, agent::Whitening},
    lce::{Differences, ImageNetworks, LceModel, SharedFrames, shared_frames::FRAMES},
    nn::{
        binary_images::PooledPatches,
        mlp::{Layout, Linear},
    },
};

/// The version of ONNX's operators. Every runtime since 2020 has it.
const OPERATORS: i64 = 13;
/// The version of the file format.
const FORMAT: i64 = 8;
/// Rows and columns of a convolution's filter.
const FILTER: usize = 5;

/// The bytes of an ONNX file that acts like the mean action of `agent` on codes of `model`. Observations have `picture` rows
/// and columns. `about` becomes the metadata of the file.
///
/// # Errors
/// The parts do not fit each other.
pub fn export(
    model: &LceModel,
    agent: &Agent,
    picture: (usize, usize),
    about: &[(&str, String)],
) -> anyhow::Result<Vec<u8>> {
    let (rows, columns) = picture;
    ensure!(
        rows * columns == model.sizes.pixels,
        "the model reads {} pixels, not {rows} x {columns}",
        model.sizes.pixels
    );
    ensure!(
        agent.latent == model.sizes.latent,
        "the agent acts on codes of {} numbers, not {}",
        agent.latent,
        model.sizes.latent
    );
    let mut graph = Builder::default();
    let of = |name| [Err(name), Ok(rows), Ok(columns)];
    let now = graph.input(
        "observation",
        UINT8,
        &of("batch"),
        "pictures: pixels from 0 to 255; older frames above newer ones",
    );
    let goal = graph.input("goal", UINT8, &of("goals"), "pictures of goals: one for each observation, or one for all");
    let (now, goal) = (encode(&mut graph, model, &now, picture)?, encode(&mut graph, model, &goal, picture)?);
    let (now, goal) =
        (whiten(&mut graph, agent.whitening.as_ref(), &now), whiten(&mut graph, agent.whitening.as_ref(), &goal));
    let shape = graph.operator("Shape", &[&now], Vec::new());
    let goal = graph.operator("Expand", &[&goal, &shape], Vec::new());
    let mut x = graph.operator("Concat", &[&now, &goal], vec![number("axis", 1)]);
    let layers = agent.nets.actor.mlp.layers;
    for (at, layer) in layers.iter().enumerate() {
        let is_last = at + 1 == layers.len();
        // The other outputs of the last layer are log standard deviations.
        let outputs = if is_last { agent.action } else { layer.n_out };
        x = affine(&mut graph, *layer, &agent.acting, outputs, &x);
        x = graph.operator(if is_last { "Tanh" } else { "Relu" }, &[&x], Vec::new());
    }
    let about_action = "actions from -1 to 1, as shares of their limits";
    let graph = graph.finish(&x, "action", &[Err("batch"), Ok(agent.action)], about_action);
    let model = Model {
        ir_version: FORMAT,
        producer_name: "carl-pipe".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPERATORS }],
        metadata_props: about
            .iter()
            .map(|(key, value)| Property { key: (*key).to_owned(), value: value.clone() })
            .collect(),
    };
    Ok(model.encode_to_vec())
}

/// The means of E(·|x).
fn encode(graph: &mut Builder, model: &LceModel, picture: &Value, size: (usize, usize)) -> anyhow::Result<Value> {
    let picture = graph.operator("Cast", &[picture], vec![number("to", FLOAT.into())]);
    let white = graph.floats(&[], &[255.0]);
    let picture = graph.operator("Div", &[&picture, &white], Vec::new());
    let layers = Layers { layout: &model.nets.layout, arena: &model.arena };
    match model.sizes.images {
        ImageNetworks::Dense => {
            let flat = graph.reshape(&picture, &[-1, model.sizes.pixels as i64]);
            layers.network(graph, "encoder", model.sizes.latent, flat)
        }
        ImageNetworks::Patches(patches) => {
            let pooled = pool(graph, &picture, patches, size.0);
            layers.network(graph, "encoder", model.sizes.latent, pooled)
        }
        ImageNetworks::SharedFrames(frames) => shared_frames(graph, &layers, frames, &picture, size.0),
        ImageNetworks::Convolutional { frames, rows, columns } => {
            let picture = graph.reshape(&picture, &[-1, frames as i64, rows as i64, columns as i64]);
            let mut x = picture;
            for (at, stride) in [1, 2, 2, 2].into_iter().enumerate() {
                x = layers.convolution(graph, &format!("encoder.{at}"), stride, &x)?;
            }
            // Our dense layers read convolutions pixel by pixel.
            let x = graph.operator("Transpose", &[&x], vec![numbers("perm", &[0, 2, 3, 1])]);
            let flat = graph.reshape(&x, &[-1, model.sizes.encoder[0] as i64]);
            layers.network(graph, "encoder.dense", model.sizes.latent, flat)
        }
    }
}

/// The share of each patch that is lit, of pictures with so many rows.
fn pool(graph: &mut Builder, pictures: &Value, patches: PooledPatches, rows: usize) -> Value {
    let PooledPatches { columns, side } = patches;
    let channel = graph.reshape(pictures, &[-1, 1, rows as i64, columns as i64]);
    let square = [side as i64; 2];
    let pooled =
        graph.operator("AveragePool", &[&channel], vec![numbers("kernel_shape", &square), numbers("strides", &square)]);
    graph.reshape(&pooled, &[-1, (rows * columns / patches.area()) as i64])
}

/// The code of two frames that one network reads: the coordinates in the newer frame, and their scaled differences.
fn shared_frames(
    graph: &mut Builder,
    layers: &Layers<'_>,
    frames: SharedFrames,
    picture: &Value,
    rows: usize,
) -> anyhow::Result<Value> {
    let pooled = pool(graph, picture, frames.read, rows / FRAMES);
    let m = frames.coordinates;
    let positions = layers.network(graph, "encoder", m, pooled)?;
    let positions = graph.reshape(&positions, &[-1, FRAMES as i64, m as i64]);
    let mut frame = |at: i64| {
        let at = graph.whole(&[at]);
        let picked = graph.operator("Gather", &[&positions, &at], vec![number("axis", 1)]);
        graph.reshape(&picked, &[-1, m as i64])
    };
    let (old, new) = (frame(0), frame(1));
    let (scale, is_mixed) = match frames.differences {
        Differences::None => return Ok(new),
        Differences::Scaled { scale } => (scale, false),
        Differences::Mixed { scale, .. } => (scale, true),
    };
    let mut differences = graph.operator("Sub", &[&new, &old], Vec::new());
    if is_mixed {
        let mixing = layers.layer("encoder.mixing")?;
        differences = affine(graph, mixing, layers.arena, mixing.n_out, &differences);
    }
    let scale = graph.floats(&[], &[scale as f32]);
    let differences = graph.operator("Mul", &[&differences, &scale], Vec::new());
    Ok(graph.operator("Concat", &[&new, &differences], vec![number("axis", 1)]))
}

/// (z - mean) inverse.
fn whiten(graph: &mut Builder, whitening: Option<&Whitening>, z: &Value) -> Value {
    let Some(Whitening { mean, inverse }) = whitening else { return z.clone() };
    let (mean, inverse) = (graph.floats(&[mean.len()], mean), graph.floats(&[inverse.len()], inverse));
    let centred = graph.operator("Sub", &[z, &mean], Vec::new());
    graph.operator("Mul", &[&centred, &inverse], Vec::new())
}

/// The first `outputs` outputs of an affine layer.
fn affine(graph: &mut Builder, layer: Linear, arena: &[f32], outputs: usize, x: &Value) -> Value {
    let kept: Vec<f32> =
        layer.w(arena).chunks_exact(layer.n_out).flat_map(|column| &column[..outputs]).copied().collect();
    let weights = graph.floats(&[layer.n_in, outputs], &kept);
    let biases = graph.floats(&[outputs], &layer.b(arena)[..outputs]);
    graph.operator("Gemm", &[x, &weights, &biases], Vec::new())
}

/// The layers of a model by name.
struct Layers<'a> {
    layout: &'a Layout,
    arena: &'a [f32],
}

impl Layers<'_> {
    fn layer(&self, name: &str) -> anyhow::Result<Linear> {
        let found = self.layout.layers.iter().find(|(other, _)| other == name);
        found.map(|(_, layer)| *layer).with_context(|| format!("the model has no layer `{name}`"))
    }

    /// The layers `NAME.0`, `NAME.1`, … with ReLU between them, and the first `outputs` outputs of the last.
    fn network(&self, graph: &mut Builder, name: &str, outputs: usize, x: Value) -> anyhow::Result<Value> {
        let count = (0..).take_while(|at| self.layer(&format!("{name}.{at}")).is_ok()).count();
        let mut x = x;
        for at in 0..count {
            let layer = self.layer(&format!("{name}.{at}"))?;
            let is_last = at + 1 == count;
            x = affine(graph, layer, self.arena, if is_last { outputs } else { layer.n_out }, &x);
            if !is_last {
                x = graph.operator("Relu", &[&x], Vec::new());
            }
        }
        Ok(x)
    }

    /// A convolution with ReLU. Our weights are \[tap\]\[input\]\[output\], those of ONNX \[output\]\[input\]\[tap\].
    fn convolution(&self, graph: &mut Builder, name: &str, stride: i64, x: &Value) -> anyhow::Result<Value> {
        let layer = self.layer(name)?;
        let (taps, outputs) = (FILTER * FILTER, layer.n_out);
        let inputs = layer.n_in / taps;
        let ours = layer.w(self.arena);
        let mut weights = Vec::with_capacity(ours.len());
        for output in 0..outputs {
            for input in 0..inputs {
                weights.extend((0..taps).map(|tap| ours[(tap * inputs + input) * outputs + output]));
            }
        }
        let weights = graph.floats(&[outputs, inputs, FILTER, FILTER], &weights);
        let biases = graph.floats(&[outputs], layer.b(self.arena));
        let border = (FILTER / 2) as i64;
        let attributes = vec![numbers("strides", &[stride; 2]), numbers("pads", &[border; 4])];
        let x = graph.operator("Conv", &[x, &weights, &biases], attributes);
        Ok(graph.operator("Relu", &[&x], Vec::new()))
    }
}
