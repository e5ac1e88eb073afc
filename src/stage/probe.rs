//! The probe of latent maps: it encodes images of known states and keeps the states to itself. A training stage can
//! record the map of its model in this way without ever holding a true state.

use crate::{
    artifact::{Codes, LatentMap},
    env::Task,
    lce::LceModel,
    num::linalg::solve_augmented,
    record::{At, MapFrame, Recorder, topic},
};

/// Images of known states, with the states; none where the task has no map.
#[derive(Debug, Default)]
pub struct MapProbe {
    frames: Vec<u8>,
    goals: Vec<u8>,
    grid: Vec<[u32; 2]>,
    places: Vec<[f32; 2]>,
    coordinates: Vec<Vec<f32>>,
}

impl MapProbe {
    /// The states on the map of a task.
    pub(super) fn new(task: &Task) -> Self {
        let Some(system) = task.system() else { return Self::default() };
        let states = system.map_states();
        Self {
            frames: states.iter().flat_map(|(state, _)| system.observe(&system.before(state), state)).collect(),
            goals: system.goals().iter().flat_map(|goal| system.observe_at_rest(goal)).collect(),
            grid: states.iter().map(|(_, cell)| cell.map(|i| i as u32)).collect(),
            places: states.iter().filter_map(|(state, _)| system.place(state)).collect(),
            coordinates: states.iter().map(|(state, _)| system.coordinates(state)).collect(),
        }
    }

    /// Whether the task has a map.
    pub(super) fn has_map(&self) -> bool {
        !self.grid.is_empty()
    }

    /// The map of a model. It holds true positions, so only the stage that exports maps may ask for it.
    pub(super) fn map(&self, model: &LceModel) -> LatentMap {
        let latent = model.sizes.latent;
        let states = model.encode_means(&model.pictures(&self.frames));
        let goals = model.encode_means(&model.pictures(&self.goals));
        let quality = affine_fit(&states, latent, &self.coordinates);
        LatentMap::new(self.grid.clone(), self.places.clone(), Codes { latent, states, goals }, quality)
    }

    /// Records the map of a model. It returns nothing, because the map's quality depends on true positions.
    pub fn record(&self, model: &LceModel, record: &mut Recorder, at: At) {
        if self.has_map() {
            write(&self.map(model), record, at);
        }
    }
}

/// Writes a map to a recording.
pub fn write(map: &LatentMap, record: &mut Recorder, at: At) {
    let pad = |code: &[f32]| [0, 1, 2].map(|i| code.get(i).copied().unwrap_or(0.0));
    let latents: Vec<[f32; 3]> = map.codes.chunks_exact(map.latent).map(pad).collect();
    let goals: Vec<[f32; 3]> = map.goals.chunks_exact(map.latent).map(pad).collect();
    let frame = MapFrame { positions: &map.places, latents: &latents, goals: &goals, quality: map.quality };
    record.latent_map(topic::LATENT_MAP, at, &frame);
}

/// R² of the best affine map from codes to coordinates: 1 for a perfect fit, 0 where codes say nothing.
pub(super) fn affine_fit(codes: &[f32], latent: usize, coordinates: &[Vec<f32>]) -> f64 {
    let count = coordinates.first().map_or(0, Vec::len);
    // Numbers of a code that all states share say nothing, such as speeds of states at rest.
    let varies = |&k: &usize| codes.iter().skip(k).step_by(latent).any(|&z| z != codes[k]);
    let varying: Vec<usize> = (0..latent).filter(varies).collect();
    let row = |i: usize| varying.iter().map(|&k| f64::from(codes[i * latent + k])).chain([1.0]).collect::<Vec<f64>>();
    // Normal equations, with the right-hand side of every coordinate to the right.
    let width = varying.len() + 1;
    let mut equations = vec![vec![0.0; width + count]; width];
    for (i, place) in coordinates.iter().enumerate() {
        let x = row(i);
        for (a, equation) in equations.iter_mut().enumerate() {
            for (entry, b) in equation.iter_mut().zip(x.iter().copied().chain(place.iter().map(|&c| f64::from(c)))) {
                *entry += x[a] * b;
            }
        }
    }
    let Some(weights) = solve_augmented(equations) else { return 0.0 };
    let (mut rest, mut total) = (0.0, 0.0);
    for k in 0..count {
        let mean = coordinates.iter().map(|p| f64::from(p[k])).sum::<f64>() / coordinates.len() as f64;
        for (i, place) in coordinates.iter().enumerate() {
            let read = row(i).iter().zip(&weights).map(|(x, w)| x * w[k]).sum::<f64>();
            rest += (f64::from(place[k]) - read).powi(2);
            total += (f64::from(place[k]) - mean).powi(2);
        }
    }
    1.0 - rest / total
}

#[cfg(test)]
mod tests {
    #[test]
    fn an_affine_map_has_quality_one_and_a_constant_one_zero() {
        let places: Vec<Vec<f32>> = (0..100).map(|i| vec![(i % 10) as f32 / 10.0, (i / 10) as f32 / 10.0]).collect();
        let codes: Vec<f32> = places.iter().flat_map(|p| [2.0 * p[0] - p[1] + 1.0, p[0] + 3.0 * p[1]]).collect();
        assert!((super::affine_fit(&codes, 2, &places) - 1.0).abs() < 1e-6);
        assert!(super::affine_fit(&vec![1.0; 200], 2, &places).abs() < 1e-6);
    }

    #[test]
    fn numbers_that_all_codes_share_do_not_matter() {
        let places: Vec<Vec<f32>> = (0..10).map(|i| vec![i as f32]).collect();
        let codes: Vec<f32> = (0..10).flat_map(|i| [0.0, 2.0 * i as f32, 0.0]).collect();
        assert!((super::affine_fit(&codes, 3, &places) - 1.0).abs() < 1e-6);
    }
}
