//! The colour of a true position in a latent map.

/// The colours of the corners of the true space, as red, green and blue: top left, top right, bottom left, bottom
/// right.
const TOP_LEFT: [f32; 3] = [58.0, 76.0, 192.0];
const TOP_RIGHT: [f32; 3] = [220.0, 70.0, 140.0];
const BOTTOM_LEFT: [f32; 3] = [30.0, 170.0, 140.0];
const BOTTOM_RIGHT: [f32; 3] = [250.0, 200.0, 60.0];

/// The colour of a goal.
pub(super) const GOAL: [u8; 4] = [255, 255, 255, 255];

/// The colour of a position, blended from the corners; red, green, blue and opacity.
pub(super) fn of_position([row, col]: [f32; 2]) -> [u8; 4] {
    let (down, right) = (row.clamp(0.0, 1.0), col.clamp(0.0, 1.0));
    let blend = |from: f32, to: f32, share: f32| from + (to - from) * share;
    let mut rgba = [255; 4];
    for (channel, value) in rgba.iter_mut().take(3).enumerate() {
        let top = blend(TOP_LEFT[channel], TOP_RIGHT[channel], right);
        let bottom = blend(BOTTOM_LEFT[channel], BOTTOM_RIGHT[channel], right);
        *value = blend(top, bottom, down) as u8;
    }
    rgba
}
