//! Whether the inputs of a stage fit each other. A pipeline cannot join other ones, but an own kind of stage may make them.

use anyhow::ensure;

use crate::{artifact::Transitions, control::Agent, lce::LceModel};

/// Refuses no transitions, and a model of input `port` that reads other observations or actions.
pub(super) fn model(port: &str, model: &LceModel, transitions: &Transitions) -> anyhow::Result<()> {
    ensure!(!transitions.is_empty(), "there are no transitions to learn from");
    let (sizes, pixels, action) = (&model.sizes, transitions.pixels(), transitions.action_dim);
    ensure!(
        (sizes.pixels, sizes.action) == (pixels, action),
        "the model of input `{port}` reads {} pixels and {} action components; the transitions have {pixels} and {action}",
        sizes.pixels,
        sizes.action
    );
    Ok(())
}

/// Refuses an agent of input `port` that reads other codes, or gives other actions, than a model.
pub(super) fn agent(port: &str, agent: &Agent, model: &LceModel) -> anyhow::Result<()> {
    let (sizes, latent, action) = (&model.sizes, agent.latent, agent.action);
    ensure!(
        (sizes.latent, sizes.action) == (latent, action),
        "the agent of input `{port}` has {latent} latent and {action} action components; its model has {} and {}",
        sizes.latent,
        sizes.action
    );
    Ok(())
}

/// Refuses codes that are not finite. A model with finite but extreme weights may give such codes.
pub(super) fn finite_codes(port: &str, codes: Vec<f32>) -> anyhow::Result<Vec<f32>> {
    ensure!(
        codes.iter().all(|number| number.is_finite()),
        "the model of input `{port}` gives codes that are not finite"
    );
    Ok(codes)
}
