//! The JSON schema of `[task]`.

use serde_json::{Value as Json, json};

/// What a task may hold.
pub(super) fn schema() -> Json {
    let number = json!({ "type": "number" });
    json!({ "type": "object", "additionalProperties": false, "required": ["env"], "properties": {
        "env": { "enum": ["planar", "swing_up", "cart_pole", "three_pole"] },
        "noise": number, "step": number, "torque": number,
        "links": { "type": "integer", "minimum": 0 },
    } })
}
