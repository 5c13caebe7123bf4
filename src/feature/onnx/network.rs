//! What does one layer of a network in an ONNX file say of an input?
//!
//! The only module that names `tract`. A network that cannot be used is an error that names the
//! file and what helps, and so is one that makes `tract` panic: a file is nobody's word that its
//! numbers fit together.

use std::sync::Arc;

use tract_onnx::prelude::*;
use tract_onnx::tract_hir::infer::Factoid;
use tract_onnx::tract_hir::internal::{DimLike, TractErrorContext};

use super::{Model, OnnxConfig};
use fremen::error::{Error, ErrorKind, Result, catching};

/// A grid of fewer cells a side says next to nothing of where something is.
const MIN_CELLS: usize = 3;
/// So many layers are listed in an error.
const MAX_LISTED: usize = 40;
/// Characters that are shown of what `tract` says.
const MAX_CAUSE: usize = 240;

/// A network up to one layer, for inputs of one size.
pub(super) struct Network {
    plan: Arc<TypedRunnableModel>,
    /// Channels, rows, columns.
    input: [usize; 3],
    output: [usize; 3],
}

impl Network {
    /// Reads a model; errors name its file.
    pub(super) fn load(model: &Model, config: &OnnxConfig) -> Result<Self> {
        let loaded = catching(|| load(&model.bytes, config), panicked);
        loaded.map_err(|error| error.with_path(&model.path))
    }

    /// Channels, rows and columns of the layer.
    pub(super) fn output_shape(&self) -> [usize; 3] {
        self.output
    }

    /// The layer's values for the planes of an input, in planes.
    ///
    /// Fails with [`ErrorKind::Format`] if one is no finite number.
    pub(super) fn run(&self, planes: &[f32]) -> Result<Vec<f32>> {
        let work = || {
            let [channels, rows, columns] = self.input;
            let values = Tensor::from_shape(&[1, channels, rows, columns], planes)
                .and_then(|input| self.plan.run(tvec!(input.into())))
                .and_then(|outputs| values(&outputs))
                .map_err(|cause| failed("the network cannot be run", &cause))?;
            if values.iter().all(|value| value.is_finite()) {
                return Ok(values);
            }
            let message = "the layer gives what is no number (NaN or infinite)";
            Err(Error::new(ErrorKind::Format, message).with_help(
                "its weights are damaged, or too large for its input: export the network again, \
                 and look at mean and std",
            ))
        };
        catching(work, panicked)
    }
}

fn values(outputs: &[TValue]) -> TractResult<Vec<f32>> {
    let output = outputs.first().context("no output")?.cast_to::<f32>()?;
    Ok(output.try_as_plain_ram()?.as_slice::<f32>()?.to_vec())
}

fn load(bytes: &[u8], config: &OnnxConfig) -> Result<Network> {
    let (width, height) = config.input_size();
    let (width, height) = (width as usize, height as usize);
    let num_channels = config.normalization().len();

    // What the file says of inner shapes may be of another size of input.
    let framework = tract_onnx::onnx().with_ignore_value_info(true);
    let mut graph = framework
        .proto_model_for_read(&mut &*bytes)
        .and_then(|proto| framework.model_for_proto_model(&proto))
        .map_err(|cause| {
            failed("this is no ONNX model that can be read", &cause).with_help(
                "export the network to ONNX, with its weights in the file itself and operator set \
                 9 to 18",
            )
        })?;
    check_input(&graph, num_channels)?;
    let input = f32::fact([1, num_channels, height, width]);
    graph
        .set_input_fact(0, input.into())
        .map_err(|cause| failed("its input has no shape", &cause))?;

    let Some(layer) = find(&graph, config.layer()) else {
        let message = match config.layer() {
            "" => "no layer of the network is named".to_owned(),
            layer => format!("the network has no layer `{layer}`"),
        };
        return Err(Error::new(ErrorKind::Config, message).with_help(listing(graph)));
    };
    let all = graph.clone();
    let optimized = graph
        .with_output_outlets(&[layer])
        .and_then(InferenceModelExt::eliminate_dead_branches)
        .and_then(InferenceModelExt::into_optimized)
        .map_err(|cause| {
            let what = format!("the network cannot be run on images of {width} x {height} px");
            failed(&what, &cause).with_help("give the size that it was exported for")
        })?;
    let output = shape_of(&optimized).map_err(|cause| failed("the layer has no shape", &cause))?;
    let [1, channels, rows, columns] = *output else {
        let message = format!("the layer is no grid of cells: its shape is {output:?}");
        return Err(Error::new(ErrorKind::Config, message).with_help(listing(all)));
    };
    if rows.min(columns) < MIN_CELLS || channels == 0 {
        let message = format!("the layer has only {columns} x {rows} cells");
        return Err(Error::new(ErrorKind::Config, message).with_help(listing(all)));
    }
    let plan =
        (optimized.into_runnable()).map_err(|cause| failed("the network cannot be run", &cause))?;
    Ok(Network {
        plan,
        input: [num_channels, height, width],
        output: [channels, rows, columns],
    })
}

/// Whether the network takes one image of so many channels.
fn check_input(graph: &InferenceModel, num_channels: usize) -> Result<()> {
    let wrong = |message: String| {
        let help = "export it for one image of 3 channels, or of 1 with one number each for mean and \
                    std";
        Err(Error::new(ErrorKind::Shape, message).with_help(help))
    };
    let num_inputs = graph.inputs.len();
    if num_inputs != 1 {
        return wrong(format!(
            "the network has {num_inputs} inputs, and one image to look at"
        ));
    }
    let fact = graph
        .input_fact(0)
        .map_err(|cause| failed("its input has no shape", &cause))?;
    let dims: Vec<Option<usize>> = (fact.shape.dims())
        .map(|dim| dim.concretize()?.to_usize().ok())
        .collect();
    // A shape that is left open fits anything.
    let fits = match *dims {
        [batch, channels, _, _] => {
            batch.is_none_or(|batch| batch == 1)
                && channels.is_none_or(|channels| channels == num_channels)
        }
        [] => true,
        _ => false,
    };
    if fits {
        return Ok(());
    }
    let shown: Vec<String> = (dims.iter())
        .map(|dim| dim.map_or("?".to_owned(), |dim| dim.to_string()))
        .collect();
    wrong(format!(
        "the input of the network has the shape ({}), not (1, {num_channels}, height, width)",
        shown.join(", ")
    ))
}

/// The output called `name`, by its own name or that of its node.
fn find(graph: &InferenceModel, name: &str) -> Option<OutletId> {
    let outlets = || graph.nodes().iter().flat_map(outlets_of);
    outlets()
        .find(|&outlet| graph.outlet_label(outlet) == Some(name))
        .or_else(|| outlets().find(|outlet| graph.node(outlet.node).name == name))
}

fn outlets_of<F, O>(node: &Node<F, O>) -> impl Iterator<Item = OutletId>
where
    F: Fact + Clone + 'static,
    O: std::fmt::Debug + std::fmt::Display + AsRef<dyn Op> + AsMut<dyn Op> + Clone + 'static,
{
    let id = node.id;
    (0..node.outputs.len()).map(move |slot| OutletId::new(id, slot))
}

/// The layers that are grids of cells, in words.
fn listing(mut graph: InferenceModel) -> String {
    // As far as it comes: where the network stops making sense, there are no more layers.
    let _ = graph.analyse(true);
    let mut found = Vec::new();
    for outlet in graph.nodes().iter().flat_map(outlets_of) {
        let (Ok(fact), Some(name)) = (graph.outlet_fact(outlet), graph.outlet_label(outlet)) else {
            continue;
        };
        let shape = fact.shape.concretize().unwrap_or_default();
        let sides: Vec<usize> = shape.iter().filter_map(|dim| dim.to_usize().ok()).collect();
        if let [1, channels, rows, columns] = *sides
            && rows.min(columns) >= MIN_CELLS
        {
            found.push(format!("{name} ({channels} channels, {columns} x {rows})"));
        }
    }
    if found.is_empty() {
        return "it has no layer that is a grid of cells: use another network".into();
    }
    let rest = found.len().saturating_sub(MAX_LISTED);
    found.truncate(MAX_LISTED);
    let rest = match rest {
        0 => String::new(),
        rest => format!(" and {rest} more"),
    };
    format!("use one of {}{rest}", found.join(", "))
}

fn shape_of(model: &TypedModel) -> TractResult<TVec<usize>> {
    let shape = &model.output_fact(0)?.shape;
    shape.iter().map(|dim| Ok(dim.to_usize()?)).collect()
}

fn failed(what: &str, cause: &TractError) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("{what}: {}", said(&format!("{cause:#}"))),
    )
}

/// The beginning of what a library says, in one line.
fn said(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(MAX_CAUSE) {
        Some((end, _)) => format!("{} ...", &line[..end]),
        None => line,
    }
}

/// The error for a network that makes `tract` panic.
fn panicked(text: &str) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("the network cannot be run: {}", said(text)),
    )
    .with_help("its numbers do not fit together: export it again")
}
