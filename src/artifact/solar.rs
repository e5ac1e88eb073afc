//! A SOLAR model and a SOLAR controller, as artifacts.

use anyhow::{Context as _, ensure};
use serde::{Deserialize, Serialize};

use super::{
    Artifact, EncoderOf, Files, TrainedModel, json, lce_model,
    tensors::{TensorFile, Tensors, read_json},
};
use crate::{
    lce::LceModel,
    nn::adam::Adam,
    solar::{
        LinearGaussianPolicy, MOST_ACTION, MOST_LATENT, Small, SolarModel,
        controller::{Plan, SolarController},
        mniw::{Expected, Natural},
        objective::CostModel,
        policy::PolicyStep,
    },
    store::Content,
};

/// The files of networks. They are those of an LCE model, so that whatever reads its encoder reads these too.
fn put_networks(networks: LceModel, adam: Adam<f32>) -> anyhow::Result<Files> {
    TrainedModel { model: networks, adam, suspect_goals: Vec::new() }.save()
}

fn take_networks(files: &Files) -> anyhow::Result<(LceModel, Adam<f32>)> {
    let TrainedModel { model, adam, .. } = lce_model::take_networks(files)?;
    let (latent, action) = (model.sizes.latent, model.sizes.action);
    ensure!(latent <= MOST_LATENT && action <= MOST_ACTION, "codes of {latent} and actions of {action} numbers");
    Ok((model, adam))
}

/// Adds small matrices of one shape as one tensor.
fn put(tensors: &mut Tensors, name: &str, shape: &[usize], matrices: impl Iterator<Item = Small>) {
    let numbers: Vec<f64> = matrices.flat_map(|matrix| matrix.iter().collect::<Vec<_>>()).collect();
    tensors.f64(name, shape, &numbers);
}

/// Reads small matrices of one shape.
fn take(tensors: &TensorFile<'_>, name: &str, rows: usize, columns: usize) -> anyhow::Result<Vec<Small>> {
    let numbers = tensors.f64(name)?;
    let width = rows * columns;
    ensure!(numbers.len().is_multiple_of(width), "tensor `{name}` is no list of {rows} x {columns} matrices");
    Ok(numbers.chunks_exact(width).map(|matrix| Small::from_rows(rows, columns, matrix)).collect())
}

#[derive(Serialize, Deserialize)]
struct AboutModel {
    cost_adam_steps: u64,
}

const MODEL: &str = "solar.safetensors";
const ABOUT_MODEL: &str = "solar.json";

impl Artifact for SolarModel {
    const TYPE: &'static str = "solar_model";
    const READABLE_AS: &'static [&'static str] = &[EncoderOf::TYPE];

    fn save(self) -> anyhow::Result<Files> {
        let (d, p) = (self.networks.sizes.latent, self.networks.sizes.latent + self.networks.sizes.action);
        let (count, dynamics) = (self.dynamics.len(), &self.dynamics);
        let mut tensors = Tensors::default();
        put(&mut tensors, "n1", &[count, d, d], dynamics.iter().map(|n| n.n1));
        put(&mut tensors, "n2", &[count, d, p], dynamics.iter().map(|n| n.n2));
        put(&mut tensors, "n3", &[count, p, p], dynamics.iter().map(|n| n.n3));
        put(&mut tensors, "n4", &[count], dynamics.iter().map(|n| Small::column(&[n.n4])));
        let width = self.cost.weights.len();
        tensors.f64("cost", &[width], &self.cost.weights).f64("cost.m", &[width], &self.cost_adam.m).f64(
            "cost.v",
            &[width],
            &self.cost_adam.v,
        );
        let about = AboutModel { cost_adam_steps: self.cost_adam.steps };
        let mut files = put_networks(self.networks, self.adam)?;
        files.insert(MODEL, tensors.content()?);
        files.insert(ABOUT_MODEL, json(&about)?);
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let (networks, adam) = take_networks(files)?;
        let (d, p) = (networks.sizes.latent, networks.sizes.latent + networks.sizes.action);
        let tensors = TensorFile::open(files, MODEL)?;
        let (n1, n2, n3) = (take(&tensors, "n1", d, d)?, take(&tensors, "n2", d, p)?, take(&tensors, "n3", p, p)?);
        let n4 = tensors.f64("n4")?;
        ensure!(
            !n4.is_empty() && [n1.len(), n2.len(), n3.len()] == [n4.len(); 3],
            "parameters of different numbers of transitions"
        );
        let parts = n1.into_iter().zip(n2).zip(n3).zip(n4);
        let dynamics = parts.map(|(((n1, n2), n3), n4)| Natural { n1, n2, n3, n4 }).collect();
        let [weights, m, v] = ["cost", "cost.m", "cost.v"].map(|name| tensors.f64(name));
        let (weights, m, v) = (weights?, m?, v?);
        ensure!([weights.len(), m.len(), v.len()] == [d * d + d; 3], "a cost of another size");
        let steps = read_json::<AboutModel>(files, ABOUT_MODEL)?.cost_adam_steps;
        Ok(Self { networks, adam, dynamics, cost: CostModel { weights }, cost_adam: Adam { m, v, steps } })
    }
}

const PLANS: &str = "plans.safetensors";

/// The file of plans of equal shape.
pub(crate) fn put_plans(plans: &[Plan]) -> anyhow::Result<Content> {
    let mut made = Tensors::default();
    let tensors = &mut made;
    let first = plans.first().context("there is no plan")?;
    let (steps, transitions) = (first.policy.steps.len(), first.dynamics.len());
    let (m, d) = first.policy.steps.first().map_or((0, 0), |step| (step.gain.rows(), step.gain.columns()));
    let (count, p) = (plans.len(), d + m);
    let all_steps = || plans.iter().flat_map(|plan| &plan.policy.steps);
    put(tensors, "K", &[count, steps, m, d], all_steps().map(|step| step.gain));
    put(tensors, "k", &[count, steps, m], all_steps().map(|step| step.offset));
    put(tensors, "S", &[count, steps, m, m], all_steps().map(|step| step.covariance));
    let dynamics = || plans.iter().flat_map(|plan| &plan.dynamics);
    put(tensors, "e1", &[count, transitions, d, d], dynamics().map(|e| e.e1));
    put(tensors, "e2", &[count, transitions, d, p], dynamics().map(|e| e.e2));
    put(tensors, "e3", &[count, transitions, p, p], dynamics().map(|e| e.e3));
    put(tensors, "e4", &[count, transitions], dynamics().map(|e| Small::column(&[e.e4])));
    made.content()
}

/// Reads what [`put_plans`] wrote.
pub(crate) fn take_plans(files: &Files, name: &str, d: usize, m: usize) -> anyhow::Result<Vec<Plan>> {
    let (p, tensors) = (d + m, &TensorFile::open(files, name)?);
    ensure!(
        (1..=MOST_LATENT).contains(&d) && (1..=MOST_ACTION).contains(&m),
        "codes of {d} and actions of {m} numbers"
    );
    let count = *tensors.shape("K")?.first().context("plans without a shape")?;
    let (gains, offsets, covariances) =
        (take(tensors, "K", m, d)?, take(tensors, "k", m, 1)?, take(tensors, "S", m, m)?);
    let (e1, e2, e3) = (take(tensors, "e1", d, d)?, take(tensors, "e2", d, p)?, take(tensors, "e3", p, p)?);
    let e4 = tensors.f64("e4")?;
    let (steps, transitions) = (gains.len(), e1.len());
    ensure!(
        count > 0
            && steps > 0
            && transitions > 0
            && steps.is_multiple_of(count)
            && transitions.is_multiple_of(count)
            && [offsets.len(), covariances.len()] == [steps; 2]
            && [e2.len(), e3.len(), e4.len()] == [transitions; 3],
        "plans of different lengths"
    );
    let step = |((gain, offset), covariance)| PolicyStep { gain, offset, covariance };
    let all_steps: Vec<PolicyStep> = gains.into_iter().zip(offsets).zip(covariances).map(step).collect();
    let of = |(((e1, e2), e3), e4)| Expected { e1, e2, e3, e4 };
    let dynamics: Vec<Expected> = e1.into_iter().zip(e2).zip(e3).zip(e4).map(of).collect();
    let plans = all_steps.chunks_exact(steps / count).zip(dynamics.chunks_exact(transitions / count));
    let plan = |(steps, dynamics): (&[PolicyStep], &[Expected])| Plan {
        policy: LinearGaussianPolicy { steps: steps.to_vec() },
        dynamics: dynamics.to_vec(),
    };
    Ok(plans.map(plan).collect())
}

impl Artifact for SolarController {
    const TYPE: &'static str = "solar_controller";
    const READABLE_AS: &'static [&'static str] = &[EncoderOf::TYPE];

    fn save(self) -> anyhow::Result<Files> {
        let plans = put_plans(&self.plans)?;
        let adam = Adam::new(self.networks.arena.len());
        let mut files = put_networks(self.networks, adam)?;
        files.insert(PLANS, plans);
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let (networks, _) = take_networks(files)?;
        let plans = take_plans(files, PLANS, networks.sizes.latent, networks.sizes.action)?;
        Ok(Self { networks, plans })
    }
}
