"""The likelihood of a circuit as a small neural network, in an ONNX file for HSSM.

The graph takes one trial, ``[v, threshold, t0, rt, response]``, and returns log(density + floor).
The inputs of its tanh layers are ``v * response``, since equal channels are mirror images, the log
of ``exp(threshold) - 1`` (minus the log odds at which OUT decides), and ``rt - t0``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel.support.files import replacing
from bgmodel.support.saved import Facts
from circuits.arrays import Array
from circuits.errors import InputError

INPUTS = ("v", "threshold", "t0", "rt", "response")
"""Inputs of the graph: three parameters, then the two columns of HSSM's data."""
PARAMETERS = INPUTS[:3]
KEY = "bgmodel"
"""Key of the metadata of a network in its file."""
OPSET = 17
SHIPPED = "macaque_likelihood.onnx"


@dataclass(frozen=True, eq=False, repr=False)
class LikelihoodNetwork(Facts):
    """A network for the log density of a response of a circuit; ``about`` describes it."""

    # Weights (inputs, outputs) and biases; tanh between layers.
    layers: tuple[tuple[Array, Array], ...]
    about: Mapping[str, Any]

    def facts(self) -> dict[str, str]:
        """Return its circuit, its size and its fixed numbers."""
        return {
            "circuit": str(self.about["circuit"]["name"]),
            "layers": "-".join(str(len(bias)) for _, bias in self.layers),
            "t0_sd_s": f"{self.about['t0_sd_s']:g}",
            "floor_per_s": f"{self.about['floor_per_s']:g}",
        }

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Range of each parameter for which the network was trained."""
        return {name: (float(a), float(b)) for name, (a, b) in self.about["bounds"].items()}

    def log_density(
        self,
        v: npt.ArrayLike,
        threshold: npt.ArrayLike,
        t0: npt.ArrayLike,
        rt: npt.ArrayLike,
        response: npt.ArrayLike,
    ) -> Array:
        """Return the log density of responses 1 or -1, log 1/s, at HSSM's inputs."""
        arguments = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (v, threshold, t0, rt, response))
        )
        drift, nats, mean, time, sign = arguments
        activations = np.stack([drift * sign, np.log(np.expm1(nats)), time - mean], axis=-1)
        for number, (weights, bias) in enumerate(self.layers):
            activations = (np.tanh(activations) if number else activations) @ weights + bias
        return np.asarray(activations[..., 0])

    def for_hssm(self, path: str | Path | None = None) -> dict[str, Any]:
        """Return the arguments of ``hssm.HSSM`` except the data; ``path`` is the network's file."""
        return {
            "model": "bg_circuit",
            "choices": [-1, 1],
            "loglik": str(shipped_path() if path is None else path),
            "loglik_kind": "approx_differentiable",
            "model_config": {
                "response": ["rt", "response"],
                "list_params": list(PARAMETERS),
                "bounds": self.bounds,
                "backend": "jax",
            },
        }

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of the stored layers, in hexadecimal."""
        digest = hashlib.sha256()
        for weights, bias in self.layers:
            digest.update(weights.astype("<f4").tobytes() + bias.astype("<f4").tobytes())
        return digest.hexdigest()

    @cached_property
    def model(self) -> Any:
        """The ONNX model: one trial, all dimensions concrete, 32-bit numbers."""
        from onnx import TensorProto, checker, helper

        constants = {"minus_one": np.array([-1.0]), **_picks()}
        nodes, last = _features(helper), "features"
        for number, (weights, bias) in enumerate(self.layers):
            constants |= {f"weights_{number}": weights, f"bias_{number}": bias}
            if number:
                nodes.append(helper.make_node("Tanh", [last], [f"tanh_{number}"]))
                last = f"tanh_{number}"
            nodes.append(helper.make_node("MatMul", [last, f"weights_{number}"], [f"mul_{number}"]))
            last = "log_density" if number == len(self.layers) - 1 else f"layer_{number}"
            nodes.append(helper.make_node("Add", [f"mul_{number}", f"bias_{number}"], [last]))
        graph = helper.make_graph(
            nodes,
            "likelihood",
            [helper.make_tensor_value_info("trial", TensorProto.FLOAT, [len(INPUTS)])],
            [helper.make_tensor_value_info("log_density", TensorProto.FLOAT, [1])],
            [
                helper.make_tensor(name, TensorProto.FLOAT, value.shape, value.ravel().tolist())
                for name, value in constants.items()
            ],
        )
        opset = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=8, producer_name=KEY)
        helper.set_model_props(model, {KEY: json.dumps(dict(self.about), sort_keys=True)})
        checker.check_model(model)
        return model

    def write(self, path: str | Path) -> Path:
        """Write the network atomically as an ONNX file; return its path."""
        with replacing(path) as partial:
            partial.write_bytes(self.model.SerializeToString(deterministic=True))
        return Path(path)


def _picks() -> dict[str, Array]:
    """Return the weights that select v, threshold, response and rt - t0 of a trial, (5, 1) each."""
    taken = {"v": {"v": 1}, "threshold": {"threshold": 1}, "response": {"response": 1}}
    taken["time"] = {"rt": 1, "t0": -1}
    return {
        f"pick_{name}": np.array([[float(parts.get(each, 0))] for each in INPUTS])
        for name, parts in taken.items()
    }


def _features(helper: Any) -> list[Any]:
    """Return the nodes from a trial to the three inputs of the layers."""
    names = ("v", "threshold", "response", "time")
    nodes = [helper.make_node("MatMul", ["trial", f"pick_{name}"], [name]) for name in names]
    return [
        *nodes,
        helper.make_node("Mul", ["v", "response"], ["drift"]),
        helper.make_node("Exp", ["threshold"], ["exp"]),
        helper.make_node("Add", ["exp", "minus_one"], ["less_one"]),
        helper.make_node("Log", ["less_one"], ["odds"]),
        helper.make_node("Concat", ["drift", "odds", "time"], ["features"], axis=0),
    ]


def read_network(path: str | Path | None = None) -> LikelihoodNetwork:
    """Read a network from its ONNX file; by default the shipped one of the circuit ``macaque``."""
    import onnx

    path = shipped_path() if path is None else Path(path)
    try:
        model = onnx.load(str(path))
        about = json.loads({each.key: each.value for each in model.metadata_props}[KEY])
        held = {each.name: onnx.numpy_helper.to_array(each) for each in model.graph.initializer}
        layers = tuple(
            (held[f"weights_{k}"].astype(float), held[f"bias_{k}"].astype(float))
            for k in range(sum(name.startswith("bias_") for name in held))
        )
    except Exception as error:  # of any class: the parts of a file may hold anything
        raise InputError(
            f"{str(path)!r} can't be read as a network of bgmodel: {error}", "path"
        ) from error
    return LikelihoodNetwork(layers, about)


def shipped_path() -> Path:
    """Return the path of the network that ships with the package."""
    return Path(str(resources.files("bgmodel") / "data" / SHIPPED))
