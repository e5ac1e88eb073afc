//! Third pass: a resolved pipeline to a graph of nodes. The loop is unrolled into cells, one for each stage and round;
//! then the matrix is unrolled into nodes, one for each cell and point that differs.

mod cells;
pub(crate) mod node;
mod order;
mod reach;
mod unroll;

pub(crate) use unroll::graph;
