//! Lays out a convolution: its core, and the transpose of its core.

use super::{
    Conv, Resize, SIDE,
    axis::Axis,
    kernels::Grid,
    layer::{Fold, Padding, Phase},
};
use crate::nn::mlp::Layout;

/// Channels are filled up with zeros to a multiple of the widest vector.
fn filled(channels: usize) -> usize {
    channels.next_multiple_of(16)
}

/// What the parts of a layer are computed from.
struct Shape {
    input: [usize; 2],
    rows: Axis,
    columns: Axis,
    /// Channels of the core's input and output, filled up.
    width_in: usize,
    width_out: usize,
}

impl Conv {
    /// A layer on images of `input` rows and columns, with `channels` channels in and out. Its first random weights are
    /// bounded by the fan-in; for upsampling layers by the fan-out, as in the transposed convolutions of the paper.
    pub fn new(
        layout: &mut Layout,
        name: impl Into<String>,
        input: [usize; 2],
        channels: [usize; 2],
        resize: Resize,
        relu: bool,
    ) -> Self {
        let [c_in, c_out] = channels;
        let fan_in = SIDE * SIDE * if matches!(resize, Resize::Up(_)) { c_out } else { c_in };
        let weights = layout.conv(name, SIDE * SIDE * c_in, c_out, fan_in);
        let [rows, columns] = [0, 1].map(|axis| Axis::new(input[axis], resize, axis));
        let block = [rows.falls.len(), columns.falls.len()];
        let (width_in, width_out) = (filled(c_in), filled(c_out * block[0] * block[1]));
        let shape = Shape { input, rows, columns, width_in, width_out };
        let (padded_input, padded_deltas) = (shape.padded_input(), shape.padded_deltas());
        Self {
            weights,
            relu,
            channels,
            input,
            core: [shape.rows.outputs, shape.columns.outputs],
            block,
            stride: shape.rows.stride,
            padded_input,
            forward: shape.forward(padded_input),
            folds: shape.folds(),
            padded_deltas,
            backward: shape.backward(padded_deltas),
        }
    }
}

impl Shape {
    fn padded_input(&self) -> Padding {
        let (rows, columns) = (&self.rows, &self.columns);
        Padding { before: [rows.before, columns.before], size: [rows.padded(), columns.padded()] }
    }

    fn padded_deltas(&self) -> Padding {
        let (rows, columns) = (&self.rows, &self.columns);
        let ([above, below], [left, right]) = (rows.delta_margins(self.input[0]), columns.delta_margins(self.input[1]));
        Padding { before: [above, left], size: [rows.outputs + above + below, columns.outputs + left + right] }
    }

    /// The core.
    fn forward(&self, padded: Padding) -> Grid {
        let Self { rows, columns, width_in, width_out, .. } = self;
        let row = padded.size[1] * width_in;
        let taps = (0..rows.taps).flat_map(|y| (0..columns.taps).map(move |x| y * row + x * width_in));
        Grid {
            rows: rows.outputs,
            columns: columns.outputs,
            in_row: rows.stride * row,
            in_column: columns.stride * width_in,
            out_row: columns.outputs * width_out,
            out_column: *width_out,
            out_start: 0,
            taps: taps.collect(),
            c_in: *width_in,
            c_out: *width_out,
        }
    }

    /// How the core's weights are summed from the layer's.
    fn folds(&self) -> Vec<Fold> {
        let (rows, columns) = (&self.rows, &self.columns);
        let mut folds = Vec::new();
        for (a, y_falls) in rows.falls.iter().enumerate() {
            for (b, x_falls) in columns.falls.iter().enumerate() {
                for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
                    let core_tap = y_falls[y] * columns.taps + x_falls[x];
                    folds.push(Fold { tap: y * SIDE + x, core_tap, block: a * columns.falls.len() + b });
                }
            }
        }
        folds
    }

    /// The core's transpose: one phase for every offset below the stride.
    fn backward(&self, padded: Padding) -> Vec<Phase> {
        let offsets = (0..self.rows.stride).flat_map(|a| (0..self.columns.stride).map(move |b| [a, b]));
        let within = offsets.filter(|[a, b]| *a < self.input[0] && *b < self.input[1]);
        within.map(|first| self.phase(first, padded)).collect()
    }

    fn phase(&self, first: [usize; 2], padded: Padding) -> Phase {
        let Self { input, rows, columns, width_in, width_out } = self;
        let (mut places, mut taps) = (Vec::new(), Vec::new());
        for (y, row) in rows.reaching(first[0]) {
            for (x, column) in columns.reaching(first[1]) {
                let row = (padded.before[0] as isize + row) as usize;
                let column = (padded.before[1] as isize + column) as usize;
                places.push((row * padded.size[1] + column) * width_out);
                taps.push(y * columns.taps + x);
            }
        }
        let grid = Grid {
            rows: (input[0] - first[0]).div_ceil(rows.stride),
            columns: (input[1] - first[1]).div_ceil(columns.stride),
            in_row: padded.size[1] * width_out,
            in_column: *width_out,
            out_row: rows.stride * input[1] * width_in,
            out_column: columns.stride * width_in,
            out_start: (first[0] * input[1] + first[1]) * width_in,
            taps: places,
            c_in: *width_out,
            c_out: *width_in,
        };
        Phase { first, grid, taps }
    }
}
