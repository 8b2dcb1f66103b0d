"""Decoder networks in ONNX files, which onnxruntime evaluates without PyTorch."""

from __future__ import annotations

import importlib
import io
import json
import math
import warnings
from typing import Any

import numpy as np

from bgmodel.support.arrays import Singles
from bgmodel.tactile.networks import import_torch
from circuits.errors import InputError

KEY = "bgmodel"
"""Metadata key of the JSON description of the network."""
INPUTS, OUTPUTS = "inputs", "outputs"
OPSET = 17


def import_onnx(package: str = "onnx", extra: str = "tactile") -> Any:
    """Return a package needed for ONNX files; ImportError with instructions if missing."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        needed = f'a decoder in .onnx needs {package}: pip install ".[{extra}]"'
        raise ImportError(needed) from error


def onnx_bytes(network: Any, shape: tuple[int, ...], header: dict[str, Any]) -> bytes:
    """Return an ONNX file of a torch network on the CPU, with the input shape of one tap."""
    torch, onnx = import_torch(), import_onnx()
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # PyTorch recommends its newer exporter, which also needs onnxscript.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network.eval(),
            (torch.zeros(1, *shape),),
            stream,
            dynamo=False,
            opset_version=OPSET,
            input_names=[INPUTS],
            output_names=[OUTPUTS],
            dynamic_axes={INPUTS: {0: "taps"}, OUTPUTS: {0: "taps"}},
        )
    model = onnx.load_from_string(stream.getvalue())
    onnx.helper.set_model_props(model, {KEY: json.dumps(header, sort_keys=True)})
    return bytes(model.SerializeToString(deterministic=True))


class OnnxNetwork:
    """Network evaluated by onnxruntime on one thread, with one input and one output.

    ``header`` describes the network; ``shapes`` are those of input and outputs for one tap.
    """

    def __init__(self, content: bytes) -> None:
        runtime = import_onnx("onnxruntime", "onnx")
        options, providers = runtime.SessionOptions(), ["CPUExecutionProvider"]
        options.intra_op_num_threads = 1
        try:
            self._session = runtime.InferenceSession(content, options, providers=providers)
        except Exception as error:  # onnxruntime errors have no other common base class
            raise ValueError(str(error)) from error
        self.header = json.loads(self._session.get_modelmeta().custom_metadata_map.get(KEY, "{}"))
        self._ends = (*self._session.get_inputs(), *self._session.get_outputs())
        if len(self._ends) != 2:
            raise ValueError("its network must have one input and one output")
        self.shapes = [end.shape[1:] for end in self._ends]

    def outputs(self, inputs: Singles) -> Singles:
        """Return the outputs (taps, outputs) for inputs (taps, ...)."""
        entry, asked = self._ends
        if all(isinstance(size, int) for size in entry.shape[1:]):
            inputs = _shaped(inputs, entry.shape[1:])
        kind = np.float64 if entry.type == "tensor(double)" else np.float32
        (values,) = self._session.run([asked.name], {entry.name: inputs.astype(kind, copy=False)})
        return np.asarray(values).reshape(len(inputs), -1)


def _shaped(inputs: Singles, shape: list[int]) -> Singles:
    """Return inputs in the shape that a network takes; ValueError if their sizes differ."""
    if math.prod(inputs.shape[1:]) != math.prod(shape):
        raise InputError.of("taps", f"must give the network's input, {shape}", inputs.shape[1:])
    return inputs.reshape(len(inputs), *shape)
