"""Networks that estimate the angle of a tap: their inputs, layers, targets and read-out."""

from __future__ import annotations

import importlib
import io
import json
import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from bgmodel.tactile.taps import Taps
from circuits.arrays import Reals, Singles
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import torch


def import_torch() -> Any:
    """Return torch; ImportError with installation instructions if it is missing."""
    try:
        import torch
    except ImportError as error:
        raise ImportError('the decoder needs PyTorch: pip install ".[tactile]"') from error
    return torch


class GratingNetwork:
    """Convolutional network of Pestell et al. (2022) on z-scored 19 x 19 maps.

    Three outputs: the source's label (yaw + 90)/180, and cos and sin of twice the yaw, for which
    -90 and 90 degrees are the same orientation.
    """

    # The label has a tenth of the variance of the others: equalise their shares of the loss.
    weights: ClassVar = (10.0, 1.0, 1.0)
    range_deg: ClassVar = (-90.0, 90.0)

    @staticmethod
    def inputs(taps: Taps) -> Reals:
        """Return maps (taps, 1, 19, 19)."""
        return taps.maps()

    @staticmethod
    def shape(pins: int) -> tuple[int, ...]:
        """Return the input shape for one tap; it does not depend on the number of pins."""
        return (1, 19, 19)

    @staticmethod
    def build(shape: tuple[int, ...], width: float, dropout: float) -> torch.nn.Sequential:
        """Return the source's layers; ``width`` scales them, ``dropout`` its 0.4, 0.2, 0.2."""
        nn = import_torch().nn
        c1, c2 = max(1, round(64 * width)), max(1, round(128 * width))

        def norm(n: int, flat: bool = False) -> torch.nn.Module:
            return (nn.BatchNorm1d if flat else nn.BatchNorm2d)(n, eps=1e-3)

        def dense(n_in: int, n_out: int) -> list[torch.nn.Module]:
            layers = [nn.Linear(n_in, n_out), nn.ReLU(), norm(n_out, flat=True)]
            return [*layers, nn.Dropout(0.2 * dropout)]

        return nn.Sequential(
            *[nn.Conv2d(1, c1, 3, padding="same"), nn.ReLU(), nn.MaxPool2d(2), norm(c1)],
            *[nn.Conv2d(c1, c2, 3, padding="same"), nn.ReLU(), norm(c2)],
            *[nn.Conv2d(c2, c2, 3), nn.ReLU(), norm(c2), nn.MaxPool2d(2), norm(c2)],
            *[nn.Flatten(), nn.Dropout(0.4 * dropout)],
            *dense(9 * c2, 32),
            *dense(32, 16),
            nn.Linear(16, 3),
        )

    @staticmethod
    def augmented(maps: Reals, yaw_deg: Reals) -> tuple[Reals, Reals]:
        """Add the mirror images of maps; a square array is symmetric under reflection."""
        turned, left, up = maps[..., ::-1, ::-1], maps[..., ::-1], maps[..., ::-1, :]
        yaws = [yaw_deg, yaw_deg, -yaw_deg, -yaw_deg]
        return np.concatenate([maps, turned, left, up]), np.concatenate(yaws)

    @staticmethod
    def targets(yaw_deg: Reals) -> Reals:
        """Return target outputs, (taps, 3)."""
        double = np.radians(2 * np.asarray(yaw_deg))
        columns = [(np.asarray(yaw_deg) + 90) / 180, np.cos(double), np.sin(double)]
        return np.stack(columns, axis=1)

    @staticmethod
    def read(outputs: Reals) -> dict[str, Reals]:
        """Return ``psi_deg`` (linear, clipped to -90..90), ``orientation_deg``, ``strength``."""
        label, cosine, sine = outputs.astype(np.float64).T
        return {
            "psi_deg": np.clip(180 * label - 90, -90, 90),
            "orientation_deg": np.degrees(np.arctan2(sine, cosine)) / 2,
            "strength": np.hypot(cosine, sine),
        }

    @staticmethod
    def errors(read: dict[str, Reals], yaw_deg: Reals) -> dict[str, float]:
        """Return mean absolute errors, degrees; the first is used for early stopping."""
        linear = np.abs(read["psi_deg"] - yaw_deg)
        double = np.abs(wrapped(read["orientation_deg"] - yaw_deg, 180))
        return {"mae_deg": float(linear.mean()), "orientation_mae_deg": float(double.mean())}


class EdgeNetwork:
    """Multilayer perceptron on standardised pin displacements for the direction of an edge.

    Two outputs: cos and sin of the yaw, in -180..180 degrees.
    """

    weights: ClassVar = (1.0, 1.0)
    range_deg: ClassVar = (-180.0, 180.0)

    @staticmethod
    def inputs(taps: Taps) -> Reals:
        """Return displacements (taps, 2 * pins), mm."""
        return taps.displacement_mm.reshape(len(taps), -1)

    @staticmethod
    def shape(pins: int) -> tuple[int, ...]:
        """Return the input shape for one tap."""
        return (2 * pins,)

    @staticmethod
    def build(shape: tuple[int, ...], width: float, dropout: float) -> torch.nn.Sequential:
        """Return two hidden layers of ``256 * width`` units with dropout ``0.1 * dropout``."""
        nn = import_torch().nn
        hidden = max(1, round(256 * width))
        return nn.Sequential(
            _standardise(shape[0]),
            *[nn.Linear(shape[0], hidden), nn.ReLU(), nn.Dropout(0.1 * dropout)],
            *[nn.Linear(hidden, hidden), nn.ReLU(), nn.Dropout(0.1 * dropout)],
            nn.Linear(hidden, 2),
        )

    @staticmethod
    def augmented(inputs: Reals, yaw_deg: Reals) -> tuple[Reals, Reals]:
        """Return the taps unchanged: real pin arrays are not symmetric."""
        return inputs, yaw_deg

    @staticmethod
    def targets(yaw_deg: Reals) -> Reals:
        """Return target outputs, (taps, 2)."""
        yaw = np.radians(yaw_deg)
        return np.stack([np.cos(yaw), np.sin(yaw)], axis=1)

    @staticmethod
    def read(outputs: Reals) -> dict[str, Reals]:
        """Return ``edge_deg`` in -180..180, and ``strength``."""
        cosine, sine = outputs.astype(np.float64).T
        return {
            "edge_deg": np.degrees(np.arctan2(sine, cosine)),
            "strength": np.hypot(cosine, sine),
        }

    @staticmethod
    def errors(read: dict[str, Reals], yaw_deg: Reals) -> dict[str, float]:
        """Return mean absolute error (used for early stopping) and sd of errors, degrees."""
        error = wrapped(read["edge_deg"] - yaw_deg, 360)
        return {"mae_deg": float(np.abs(error).mean()), "sd_deg": float(error.std())}


def _standardise(features: int) -> Any:
    """Return a layer that subtracts a mean and divides by an sd, both set by ``set_scale``."""
    torch = import_torch()

    class Standardise(torch.nn.Module):  # type: ignore[name-defined]
        def __init__(self) -> None:
            super().__init__()
            self.register_buffer("mean", torch.zeros(features))
            self.register_buffer("sd", torch.ones(features))

        def forward(self, x: Any) -> Any:
            return (x - self.mean) / self.sd

    return Standardise()


def set_scale(network: Any, inputs: Reals) -> None:
    """Set mean and sd of a network's standardising layer, if any, from its training taps."""
    first = network[0]
    if hasattr(first, "sd"):
        torch = import_torch()
        first.mean.copy_(torch.from_numpy(inputs.mean(axis=0)))
        first.sd.copy_(torch.from_numpy(inputs.std(axis=0) + 1e-6))


def wrapped(angle_deg: Reals, period_deg: float) -> Reals:
    """Wrap angles to -period/2..period/2."""
    return (angle_deg + period_deg / 2) % period_deg - period_deg / 2


Network = type[GratingNetwork] | type[EdgeNetwork]
NETWORKS: dict[str, Network] = {"grating": GratingNetwork, "edge": EdgeNetwork}


@dataclass(frozen=True)
class OwnNetwork:
    """Another network: what was tapped, what it takes and what it gives."""

    stimulus: Literal["grating", "edge"] = "grating"
    """What was tapped."""
    takes: Literal["maps", "displacements"] = "maps"
    """Input for one tap: z-scored sizes of displacements on 19 x 19 points, (1, 19, 19), or
    displacements of all pins, x right and y up, mm, (pins, 2) or (2 pins,)."""
    gives: Literal["angle", "vector"] = "angle"
    """Output for one tap: the yaw, degrees, or its cosine and sine; those of twice the yaw for a
    grating, which looks the same after half a turn."""

    def __post_init__(self) -> None:
        """Check the names."""
        known = {"stimulus": NETWORKS, "takes": ("maps", "displacements"),
                 "gives": ("angle", "vector")}  # fmt: skip
        for name, words in known.items():
            word = getattr(self, name)
            require(word in words, name, f"must be {' or '.join(words)}", word)

    @property
    def network(self) -> str:
        """What was tapped, as in ``Training``."""
        return self.stimulus

    def inputs(self, taps: Taps) -> Reals:
        """Return the input of each tap (taps, ...)."""
        return taps.maps() if self.takes == "maps" else taps.displacement_mm

    def read(self, outputs: Reals) -> dict[str, Reals]:
        """Return the columns that tasks read, as the included networks do."""
        count = 1 if self.gives == "angle" else 2
        if outputs.ndim != 2 or outputs.shape[1] != count:
            must = f"must be one that gives {count} number(s) for a tap, as stated by gives"
            raise InputError.of("network", f"{must} ({self.gives})", outputs.shape[1:])
        turn, period = (2, 180.0) if self.stimulus == "grating" else (1, 360.0)
        if self.gives == "angle":
            angle, strength = outputs[:, 0].astype(np.float64), np.ones(len(outputs))
        else:
            cosine, sine = outputs.astype(np.float64).T
            angle, strength = np.degrees(np.arctan2(sine, cosine)) / turn, np.hypot(cosine, sine)
        turned = wrapped(angle, period)
        if self.stimulus == "edge":
            return {"edge_deg": turned, "strength": strength}
        linear = np.clip(angle, -90, 90)
        return {"psi_deg": linear, "orientation_deg": turned, "strength": strength}


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
