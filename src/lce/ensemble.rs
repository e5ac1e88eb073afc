//! An ensemble of dynamics: networks like F, which differ where transitions are few.
//!
//! An agent that trains long in one F learns to exploit the errors of this F. Members of an ensemble have different
//! errors, so an agent that trains in all of them cannot (Chua et al., "Deep Reinforcement Learning in a Handful of
//! Trials using Probabilistic Dynamics Models", 2018).

use super::{dynamics::Dynamics, refit, sizes::Sizes};
use crate::{
    nn::mlp::Layout,
    num::{rng::Rng, sampling},
};

/// Several networks F.
#[derive(Debug, Clone, PartialEq)]
pub struct Ensemble {
    /// The layers of each member.
    pub net: Dynamics,
    /// The parameters of each member.
    pub members: Vec<Vec<f32>>,
}

/// How the members of an ensemble are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Number of members.
    pub members: usize,
    /// Random batches for each member.
    pub steps: u64,
    /// Adam step size of the first batch. The step size falls linearly to zero.
    pub learning_rate: f64,
}

/// What an ensemble is fitted to.
#[derive(Debug, Clone, Copy)]
pub struct Moves<'a> {
    /// E(·|x) and E(·|x') of every transition in turn. Among N transitions, copy c of transition i has the index c N + i.
    pub codes: &'a [f32],
    /// Actions in -1..1, one column for every transition.
    pub actions: &'a [f32],
    /// How many copies of every transition there are.
    pub copies: usize,
}

impl Ensemble {
    /// Fits each member as [`refit::refit`] fits F. A member begins with random weights. It sees a bootstrap sample: as
    /// many transitions as there are, drawn with replacement, each with all of its copies.
    ///
    /// # Errors
    /// The number of the first step after which a parameter of a member is not finite.
    pub fn fit(sizes: &Sizes, moves: Moves<'_>, fit: Fit, rng: &mut Rng) -> Result<Self, u64> {
        let mut layout = Layout::default();
        let net = Dynamics::new(&mut layout, sizes);
        let Moves { codes, actions, copies } = moves;
        let count = actions.len() / (sizes.action * copies);
        let member = |_| -> Result<_, u64> {
            let mut arena: Vec<f32> = layout.initialize(rng);
            let seen: Vec<usize> = (0..count).map(|_| sampling::index(rng, count)).collect();
            let draw = |rng: &mut Rng| sampling::index(rng, copies) * count + seen[sampling::index(rng, count)];
            let all = count * copies;
            refit::fit(&net, &mut arena, (codes, actions), all, (fit.steps, fit.learning_rate), draw, rng)?;
            Ok(arena)
        };
        let members = (0..fit.members).map(member).collect::<Result<_, _>>()?;
        Ok(Self { net, members })
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::lce::dynamics::DynamicsPass;

    /// The spread of the members' predictions of the first coordinate's move from a code, without an action.
    fn spread(ensemble: &Ensemble, z: [f32; 2]) -> f32 {
        let predict = |arena: &Vec<f32>| {
            let mut pass = DynamicsPass::new(&ensemble.net, 1, 1);
            ensemble.net.forward(arena, &[z[0], z[1], 0.0, 0.0], &mut pass.view(1));
            pass.output()[0]
        };
        let moves: Vec<f32> = ensemble.members.iter().map(predict).collect();
        let mean = moves.iter().sum::<f32>() / moves.len() as f32;
        moves.iter().map(|it| (it - mean).abs()).sum::<f32>() / moves.len() as f32
    }

    #[test]
    fn members_agree_where_there_are_transitions_and_differ_elsewhere() {
        let mut rng = Rng::seed_from_u64(8);
        let (mut codes, mut actions) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let mut draw = || sampling::uniform(&mut rng, -1.0, 1.0);
            let (z, u) = ([draw(), draw()], [draw(), draw()]);
            // An action moves the code, and the code turns around the origin.
            let next = [z[0] + 0.3 * u[0] - 0.2 * z[1], z[1] + 0.3 * u[1] + 0.2 * z[0]];
            codes.extend([z[0], z[1], -3.0, -3.0, next[0], next[1], -3.0, -3.0]);
            actions.extend(u);
        }
        let moves = Moves { codes: &codes, actions: &actions, copies: 1 };
        let fit = Fit { members: 4, steps: 600, learning_rate: 5e-3 };
        let ensemble = Ensemble::fit(&Sizes::planar(), moves, fit, &mut rng).unwrap();
        let [near, far] = [[0.3, -0.3], [4.0, -4.0]].map(|z| spread(&ensemble, z));
        assert!(far > 3.0 * near, "{near} near the transitions, {far} elsewhere");
    }
}
