//! What runs measured: outcomes, series over seeds, tables and charts.

pub mod outcomes;
