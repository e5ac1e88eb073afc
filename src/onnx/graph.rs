//! Builds a graph of ONNX operators, one value after the other.

use super::wire::{
    Attribute, Dimension, FLOAT, Graph, INT, INT64, INTS, Length, Node, Shape, Tensor, TensorType, Type, ValueInfo,
};

/// A value in a graph: a constant, or the output of an operator.
#[derive(Debug, Clone)]
pub(super) struct Value(String);

/// A graph that is being built.
#[derive(Debug, Default)]
pub(super) struct Builder {
    graph: Graph,
    count: usize,
}

impl Builder {
    /// Adds an input; a length of `Err` is a name.
    pub(super) fn input(&mut self, name: &str, dtype: i32, shape: &[Result<usize, &str>], about: &str) -> Value {
        self.graph.input.push(value_info(name, dtype, shape, about));
        Value(name.to_owned())
    }

    /// Adds an operator with one output.
    pub(super) fn operator(&mut self, op: &str, inputs: &[&Value], attributes: Vec<Attribute>) -> Value {
        let output = self.fresh(op);
        self.graph.node.push(Node {
            input: inputs.iter().map(|value| value.0.clone()).collect(),
            output: vec![output.clone()],
            name: output.clone(),
            op_type: op.to_owned(),
            attribute: attributes,
        });
        Value(output)
    }

    /// A constant of numbers.
    pub(super) fn floats(&mut self, shape: &[usize], numbers: &[f32]) -> Value {
        self.constant(FLOAT, shape, numbers.iter().flat_map(|number| number.to_le_bytes()).collect())
    }

    /// A constant list of whole numbers, such as a shape.
    pub(super) fn whole(&mut self, numbers: &[i64]) -> Value {
        self.constant(INT64, &[numbers.len()], numbers.iter().flat_map(|number| number.to_le_bytes()).collect())
    }

    fn constant(&mut self, data_type: i32, shape: &[usize], raw_data: Vec<u8>) -> Value {
        let name = self.fresh("constant");
        let dims = shape.iter().map(|&length| length as i64).collect();
        self.graph.initializer.push(Tensor { dims, data_type, name: name.clone(), raw_data });
        Value(name)
    }

    /// The value in another shape; -1 is the length that is left.
    pub(super) fn reshape(&mut self, value: &Value, shape: &[i64]) -> Value {
        let shape = self.whole(shape);
        self.operator("Reshape", &[value, &shape], Vec::new())
    }

    /// Ends the graph with an output, which takes the place of `value`.
    pub(super) fn finish(mut self, value: &Value, name: &str, shape: &[Result<usize, &str>], about: &str) -> Graph {
        self.graph.node.push(Node {
            input: vec![value.0.clone()],
            output: vec![name.to_owned()],
            name: name.to_owned(),
            op_type: "Identity".to_owned(),
            attribute: Vec::new(),
        });
        self.graph.output.push(value_info(name, FLOAT, shape, about));
        self.graph.name = "policy".to_owned();
        self.graph
    }

    fn fresh(&mut self, what: &str) -> String {
        self.count += 1;
        format!("{}_{}", what.to_lowercase(), self.count)
    }
}

/// An attribute that is a whole number.
pub(super) fn number(name: &str, i: i64) -> Attribute {
    Attribute { name: name.to_owned(), i, r#type: INT, ..Attribute::default() }
}

/// An attribute that is a list of whole numbers.
pub(super) fn numbers(name: &str, ints: &[i64]) -> Attribute {
    Attribute { name: name.to_owned(), ints: ints.to_vec(), r#type: INTS, ..Attribute::default() }
}

fn value_info(name: &str, elem_type: i32, shape: &[Result<usize, &str>], about: &str) -> ValueInfo {
    let dimension = |length: &Result<usize, &str>| Dimension {
        value: Some(match length {
            Ok(length) => Length::Fixed(*length as i64),
            Err(name) => Length::Named((*name).to_owned()),
        }),
    };
    let shape = Some(Shape { dim: shape.iter().map(dimension).collect() });
    let r#type = Some(Type { tensor_type: Some(TensorType { elem_type, shape }) });
    ValueInfo { name: name.to_owned(), r#type, doc_string: about.to_owned() }
}
