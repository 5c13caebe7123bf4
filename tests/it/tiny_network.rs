//! A network small enough to be written down: an ONNX file made byte by byte.
//!
//! ```text
//! image (1, channels, ?, ?) -> Conv 16 x 16, stride 8 -> "waves" (24 channels) -> Relu -> "rectified"
//!       -> GlobalAveragePool -> "mean" (24 x 1 x 1) -> Flatten -> "flat"
//! ```
//!
//! The kernels are the low frequencies of the cosine transform: what a patch looks like, roughly, and
//! next to the same one pixel further. `ONNX` is written in Protocol Buffers: a field is its number and
//! type, then a number, or a length and so many bytes.

/// Side of the kernels, px.
const KERNEL: u64 = 16;
/// Between cells, px.
pub(crate) const STRIDE: u64 = 8;
/// Kernels: pairs of frequencies but that of the mean.
const NUM_CHANNELS: u64 = 24;

/// What is unusual about a network.
#[derive(Clone, Copy)]
pub(crate) struct TinyNetwork {
    pub(crate) num_inputs: u64,
    pub(crate) input_channels: u64,
    pub(crate) gain: f32,
}

impl Default for TinyNetwork {
    fn default() -> Self {
        Self {
            num_inputs: 1,
            input_channels: 3,
            gain: 1.0,
        }
    }
}

impl TinyNetwork {
    /// The bytes of its file.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let nodes = [
            node(
                "Conv",
                &["image", "kernels"],
                "waves",
                &[
                    integers("kernel_shape", &[KERNEL, KERNEL]),
                    integers("strides", &[STRIDE, STRIDE]),
                    integers("pads", &[4, 4, 4, 4]),
                ],
            ),
            node("Relu", &["waves"], "rectified", &[]),
            node("GlobalAveragePool", &["rectified"], "mean", &[]),
            node("Flatten", &["mean"], "flat", &[]),
        ];
        let mut graph: Vec<u8> = nodes.iter().flat_map(|node| bytes(1, node)).collect();
        graph.extend(bytes(2, b"tiny"));
        graph.extend(bytes(5, &self.kernels()));
        let unknown: [&[u8]; 2] = [b"height", b"width"];
        graph.extend(bytes(
            11,
            &tensor_info("image", &[1, self.input_channels], &unknown),
        ));
        for more in 1..self.num_inputs {
            graph.extend(bytes(11, &tensor_info(&format!("more{more}"), &[1], &[])));
        }
        graph.extend(bytes(12, &tensor_info("flat", &[1, NUM_CHANNELS], &[])));
        [
            number(1, 8),             // version of the format
            bytes(8, &number(2, 13)), // version of the operators
            bytes(7, &graph),
        ]
        .concat()
    }

    fn kernels(self) -> Vec<u8> {
        let wave = |at: u64, frequency: u64| {
            let phase = (at as f64 + 0.5) * frequency as f64 / KERNEL as f64;
            (phase * std::f64::consts::PI).cos() as f32
        };
        let mut values = Vec::new();
        for channel in 1..=NUM_CHANNELS {
            let (across, down) = (channel % 5, channel / 5);
            for _ in 0..self.input_channels {
                for (y, x) in (0..KERNEL).flat_map(|y| (0..KERNEL).map(move |x| (y, x))) {
                    let value = wave(x, across) * wave(y, down) * self.gain;
                    values.extend(value.to_le_bytes());
                }
            }
        }
        let dims = [NUM_CHANNELS, self.input_channels, KERNEL, KERNEL];
        let dims = dims.iter().flat_map(|&dim| number(1, dim));
        let mut tensor: Vec<u8> = dims.collect();
        tensor.extend(number(2, 1)); // 32-bit floats
        tensor.extend(bytes(8, b"kernels"));
        tensor.extend(bytes(9, &values));
        tensor
    }
}

fn node(kind: &str, inputs: &[&str], output: &str, attributes: &[Vec<u8>]) -> Vec<u8> {
    let mut node: Vec<u8> = (inputs.iter())
        .flat_map(|input| bytes(1, input.as_bytes()))
        .collect();
    node.extend(bytes(2, output.as_bytes()));
    node.extend(bytes(3, format!("the {output}").as_bytes()));
    node.extend(bytes(4, kind.as_bytes()));
    node.extend(attributes.iter().flat_map(|attribute| bytes(5, attribute)));
    node
}

/// An attribute that is a list of whole numbers.
fn integers(name: &str, values: &[u64]) -> Vec<u8> {
    let mut attribute = bytes(1, name.as_bytes());
    attribute.extend(values.iter().flat_map(|&value| number(8, value)));
    attribute.extend(number(20, 7));
    attribute
}

/// Name and type of floats with these sides; those that are names are open.
fn tensor_info(name: &str, known: &[u64], open: &[&[u8]]) -> Vec<u8> {
    let known = known.iter().map(|&side| number(1, side));
    let open = open.iter().map(|name| bytes(2, name));
    let shape: Vec<u8> = known.chain(open).flat_map(|side| bytes(1, &side)).collect();
    let tensor = [number(1, 1), bytes(2, &shape)].concat();
    [bytes(1, name.as_bytes()), bytes(2, &bytes(1, &tensor))].concat()
}

/// A field that is a number.
fn number(field: u64, value: u64) -> Vec<u8> {
    [varint(field << 3), varint(value)].concat()
}

/// A field that is so many bytes.
fn bytes(field: u64, content: &[u8]) -> Vec<u8> {
    let head = [varint(field << 3 | 2), varint(content.len() as u64)].concat();
    [&head, content].concat()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}
