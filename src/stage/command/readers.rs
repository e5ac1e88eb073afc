//! The readers of typed outputs. A reader takes what the program wrote exactly as a later stage would.

use super::params::Gives;
use crate::{
    artifact::{Artifact, Evaluation, Files, TrainedModel, Trajectories, Transitions, must_be_finite},
    control::Agent,
    stage::StageCx,
};

/// How files become an artifact.
pub(super) struct Reader {
    /// The type of the artifact.
    pub(super) artifact: &'static str,
    /// See [`Artifact::READABLE_AS`].
    pub(super) readable_as: &'static [&'static str],
    /// The metric that models are judged by.
    pub(super) headline: Option<&'static str>,
    /// Reads the files and reports metrics.
    pub(super) check: fn(&Files, &mut StageCx<'_>) -> anyhow::Result<()>,
}

/// The reader of a type.
pub(super) fn reader(gives: Gives) -> Reader {
    match gives {
        Gives::Files => Reader { artifact: "files", readable_as: &[], headline: None, check: |_, _| Ok(()) },
        Gives::Transitions => of::<Transitions>(|files, cx| {
            cx.metric("samples", read::<Transitions>(files)?.len() as f64);
            Ok(())
        }),
        Gives::Trajectories => of::<Trajectories>(|files, _| read::<Trajectories>(files).map(drop)),
        Gives::Evaluation => Reader {
            headline: Some("percent_goal"),
            ..of::<Evaluation>(|files, cx| {
                let Evaluation { percent_goal, policy_alone, .. } = read(files)?;
                cx.metric("percent_goal", percent_goal);
                cx.metric("policy_alone", policy_alone);
                Ok(())
            })
        },
        Gives::LceModel => of::<TrainedModel>(|files, _| read::<TrainedModel>(files).map(drop)),
        Gives::Agent => of::<Agent>(|files, _| read::<Agent>(files).map(drop)),
    }
}

fn of<A: Artifact>(check: fn(&Files, &mut StageCx<'_>) -> anyhow::Result<()>) -> Reader {
    Reader { artifact: A::TYPE, readable_as: A::READABLE_AS, headline: None, check }
}

fn read<A: Artifact>(files: &Files) -> anyhow::Result<A> {
    let value = A::load(files)?;
    must_be_finite(files, A::MAY_BE_MISSING)?;
    Ok(value)
}
