//! What runs reached: outcomes, the headline, series over seeds, comparisons, tables and charts.

pub mod chart;
pub mod comparison;
pub mod groups;
pub mod headline;
mod lineage;
pub mod numbers;
pub mod outcomes;
mod point;
pub mod series;
pub mod table;
mod tell_apart;
