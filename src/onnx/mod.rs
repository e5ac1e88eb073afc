//! A trained policy as one ONNX file: encoder, whitening and actor as a graph from pictures to actions.
//!
//! Runtimes for ONNX exist in Python, C++, JavaScript and on small devices, so a policy needs nothing of ours to act.

mod graph;
mod policy;
mod wire;

pub use policy::export;
