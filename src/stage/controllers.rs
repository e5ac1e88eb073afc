//! The policies that stages run, by the name of the controller.

use anyhow::Context as _;

use super::fits;
use crate::{
    control::{Acting, Agent, AgentPolicy, Controller, Ilqr, IlqrPolicy, OraclePolicy, Policy, SolarPolicy},
    env::Task,
    lce::LceModel,
    solar::SolarController,
};

/// The inputs of a stage that policies are built from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Controllers<'a> {
    pub(super) model: Option<&'a LceModel>,
    pub(super) agent: Option<&'a Agent>,
    pub(super) ilqr: Option<&'a Ilqr>,
    pub(super) solar: Option<&'a SolarController>,
}

/// The inputs that a controller cannot do without.
pub(super) fn needs(controller: Controller) -> &'static [&'static str] {
    match controller {
        Controller::Agent => &["model", "agent"],
        Controller::Ilqr => &["model", "ilqr"],
        Controller::Solar => &["solar"],
        Controller::Oracle => &[],
    }
}

impl<'a> Controllers<'a> {
    /// The policy of a controller. `acting` says how an agent chooses its actions.
    pub(super) fn policy(
        self,
        controller: Controller,
        acting: Acting,
        task: &Task,
    ) -> anyhow::Result<Box<dyn Policy + 'a>> {
        Ok(match controller {
            Controller::Agent => {
                let (model, agent) =
                    self.model.zip(self.agent).context("an agent needs the inputs `model` and `agent`")?;
                fits::agent("agent", agent, model)?;
                Box::new(AgentPolicy::new(model, agent, acting))
            }
            Controller::Ilqr => {
                let (model, ilqr) = self.model.zip(self.ilqr).context("iLQR needs the inputs `model` and `ilqr`")?;
                Box::new(IlqrPolicy::new(model, ilqr))
            }
            Controller::Solar => {
                let SolarController { networks, plans } = self.solar.context("SOLAR needs the input `solar`")?;
                Box::new(SolarPolicy::new(networks, plans, acting))
            }
            Controller::Oracle => Box::new(OraclePolicy::of(task)?),
        })
    }
}
