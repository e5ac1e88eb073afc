//! Defaults for a task that nobody has tuned anything for: rules from the sizes of its pictures and actions.
//!
//! They follow the built-in task that is most alike. `docs/your-own-task.md` states them.

use serde_json::{Value, json};

use crate::env::{BackwardSizes, DefaultsOf, Frames, NetworkSizes, Preset, Spec};

/// The most numbers of an observation that fully connected networks read one by one.
const MOST_DENSE: usize = 8192;
/// The most patches of a frame.
const MOST_PATCHES: usize = 600;
/// Convolutions halve rows and columns three times.
const HALVED: usize = 8;

/// Widths of networks.
pub(super) fn widths(spec: &Spec) -> NetworkSizes {
    let Frames { height, width, count, .. } = spec.frames;
    let is_convolutional = !is_small(spec) && height.is_multiple_of(HALVED) && width.is_multiple_of(HALVED);
    let smallest = ((height / HALVED) * (width / HALVED)).max(1);
    let convolved = smallest * (1000 / smallest).max(1);
    let hidden = if count * spec.frames.pixels() > 2000 { 500 } else { 300 };
    NetworkSizes {
        // A position for each component of an action and one more; as many speeds where frames show them.
        latent: (count.min(2) * (1 + spec.action_limit.len())).clamp(2, 32),
        is_convolutional,
        encoder: if is_convolutional { [convolved, 300] } else { [hidden; 2] },
        decoder: if is_convolutional { [300, convolved] } else { [hidden; 2] },
        dynamics: [40, 40],
        backward: BackwardSizes { latent: 10, action: 10, observation: 200, joint: 200 },
    }
}

/// Whether networks read every number of an observation.
fn is_small(spec: &Spec) -> bool {
    spec.frames.count * spec.frames.pixels() <= MOST_DENSE
}

pub(super) fn defaults(of: &DefaultsOf<'_>) -> Value {
    let spec = of.task.spec();
    let shows_speeds = spec.frames.count > 1;
    match (of.stage, of.preset) {
        // No environment can be put into a drawn state, so transitions follow episodes of random actions.
        ("generate_data", _) => json!({ "trajectory": spec.horizon.max(2) }),
        ("train_lce", Preset::Recipe) => train_lce(of, &spec),
        ("train_sac", Preset::Recipe) if shows_speeds => {
            json!({ "steps": 3000, "rollout": 10, "learning_rate_end_factor": 0.05 })
        }
        ("train_sac", Preset::Recipe) => json!({ "steps": 3000 }),
        _ => json!({}),
    }
}

fn train_lce(of: &DefaultsOf<'_>, spec: &Spec) -> Value {
    let mut table = json!({ "epochs": 300 });
    if spec.frames.count > 1 {
        // What moves by itself, as in `swing_up`.
        table["passive_dynamics"] = "quadratic".into();
        table["warm_up"]["loss"] = json!({ "scale": 2.0, "anchor": 100.0, "huber_delta": 1000.0 });
        table["lambda"]["anchor"] = 10.0.into();
    }
    if !of.given.contains_key("networks")
        && let Some(networks) = patches(spec)
    {
        table["networks"] = networks;
    }
    table
}

/// Networks that read patches of large pictures; `None` for small pictures, and for those that cannot be cut.
fn patches(spec: &Spec) -> Option<Value> {
    let Frames { height, width, channels, count, .. } = spec.frames;
    let cuts = |side: &usize| height.is_multiple_of(*side) && width.is_multiple_of(*side);
    let fits = |side: &usize| channels * (height / side) * (width / side) <= MOST_PATCHES;
    let side = (2..=15).find(|side| cuts(side) && fits(side)).filter(|_| !is_small(spec))?;
    if count == 2 {
        let coordinates = (2 * spec.action_limit.len()).clamp(4, 16);
        return Some(json!({ "shared_frames": { "side": side, "predicted_side": side, "coordinates": coordinates } }));
    }
    Some(json!({ "pooled_patches": { "side": side } }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(height: usize, width: usize, channels: usize, count: usize) -> Spec {
        let frames = Frames { height, width, channels, shades: true, count };
        Spec { frames, action_limit: vec![1.0], horizon: 100, goals: 1, goal_radius: 1.0 }
    }

    #[test]
    fn small_pictures_are_read_whole_and_large_ones_in_patches() {
        assert_eq!(patches(&spec(64, 64, 1, 2)), None);
        let shared = |side| json!({ "shared_frames": { "side": side, "predicted_side": side, "coordinates": 4 } });
        assert_eq!(patches(&spec(80, 80, 1, 2)), Some(shared(4)));
        assert_eq!(patches(&spec(64, 64, 3, 2)), Some(shared(8)));
        assert_eq!(patches(&spec(96, 96, 3, 1)), Some(json!({ "pooled_patches": { "side": 8 } })));
        assert_eq!(patches(&spec(97, 101, 1, 1)), None);
    }

    #[test]
    fn convolutions_match_the_sizes_of_their_pictures() {
        for (height, width) in [(80, 80), (96, 64), (256, 256), (88, 72)] {
            let NetworkSizes { is_convolutional, encoder, decoder, .. } = widths(&spec(height, width, 3, 2));
            let smallest = height / 8 * (width / 8);
            assert!(is_convolutional && encoder[0].is_multiple_of(smallest) && encoder[0] == decoder[1]);
        }
        assert!(!widths(&spec(97, 101, 3, 2)).is_convolutional);
        assert!(!widths(&spec(48, 48, 1, 2)).is_convolutional);
    }
}
