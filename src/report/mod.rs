//! What runs measured: outcomes, series over seeds, tables and charts.

pub mod headline;
pub mod outcomes;
