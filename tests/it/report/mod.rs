//! What runs reached, read off their manifests.

mod headline;
