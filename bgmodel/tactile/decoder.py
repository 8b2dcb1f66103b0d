"""Decoder: a trained network that estimates the angle of a tap; training and file formats."""

from __future__ import annotations

import copy
import json
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bgmodel.support.checks import check_positive, path_of
from bgmodel.support.files import check_writable, checksum, provenance, recorded, replacing
from bgmodel.tactile.networks import (
    NETWORKS,
    Network,
    OnnxNetwork,
    OwnNetwork,
    import_torch,
    onnx_bytes,
    set_scale,
)
from bgmodel.tactile.taps import Taps, warn_of_angles, warn_of_copied_taps
from circuits.arrays import Integers, Reals, Truths
from circuits.errors import DataWarning, InputError, require

if TYPE_CHECKING:
    import pandas as pd
    import torch

_ALONE = threading.Lock()
"""Held while a network is trained: all threads share PyTorch's random numbers."""
BATCH = 4096
ENDINGS = (".safetensors", ".onnx")
"""File name endings of decoders; an .onnx file is read without PyTorch."""


@dataclass(frozen=True)
class Training:
    """Architecture and training options of a decoder."""

    network: Literal["grating", "edge"] = "grating"
    """CNN on 19 x 19 maps for gratings (Pestell et al. 2022), or perceptron for edges (ours)."""
    width: float = 0.25
    """Filters or units as a fraction of the full network; 1 in Pestell et al. 2022, 0.25 our
    choice for speed, 1 for edges."""
    epochs: int = 8
    """Maximum number of passes over the taps and their mirror images; 8, 20 for edges; assumed."""
    patience: int = 20
    """Epochs without improvement in validation error before stopping; 20 in Pestell et al. 2022."""
    batch: int = 64
    """Taps per step; 32 in Pestell et al. 2022, 64 our choice for speed, 128 for edges."""
    learning_rate: float = 3e-3
    """Peak step size of AdamW, which rises and falls once (Smith & Topin 2018), 3e-3, 2e-3 for
    edges; the source uses RMSprop at a constant 1e-4 for hundreds of epochs; assumed."""
    dropout: float = 0.0
    """Dropout as a fraction of the full network's; 1 in Pestell et al. 2022, 0 our choice for the
    narrow network, which has fewer units to drop, 1 for edges."""
    l2: float = 0.005
    """Weight decay of the two hidden dense layers; 0.005 in Pestell et al. 2022, 0 for edges."""
    validation: float = 0.25
    """Fraction of taps held out for validation; 2 016 of 8 000 in Pestell et al. 2022, 0.15 for
    edges."""

    def __post_init__(self) -> None:
        known = f"must be one of {sorted(NETWORKS)}"
        require(self.network in NETWORKS, "network", known, self.network)
        check_positive(width=self.width, learning_rate=self.learning_rate)
        for name in ("epochs", "patience", "batch"):
            require(getattr(self, name) >= 1, name, "must be at least 1", getattr(self, name))
        require(0 < self.validation < 1, "validation", "must lie between 0 and 1", self.validation)
        require(0 <= self.dropout <= 2, "dropout", "must be within 0..2", self.dropout)

    def held_out(self, taps: int) -> int:
        """Return the number of taps for validation; ValueError if too few of all are left."""
        held = round(self.validation * taps)
        if held < 1 or taps - held < 2 * self.batch:
            raise InputError(
                f"training needs at least {2 * self.batch} taps plus those for validation, "
                f"got {taps} in all",
                "taps",
            )
        return held


# Tuned on the error for held-out parts of the training taps.
EDGE = Training(
    "edge",
    width=1.0,
    epochs=20,
    batch=128,
    learning_rate=2e-3,
    dropout=1.0,
    l2=0.0,
    validation=0.15,
)


@dataclass
class Decoder:
    """A trained network and everything needed to reuse it."""

    network: Any = field(repr=False)  # a torch.nn.Module or OnnxNetwork
    training: Training | OwnNetwork
    rest_mm: Reals = field(repr=False)  # (pins, 2), of the pins it was trained on; none if unknown
    # Per epoch training loss and validation errors, degrees.
    history: list[dict[str, float]] = field(repr=False)
    about: dict[str, Any]  # provenance of taps and training
    # (taps,), identifiers, see Taps.numbers
    trained_on: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)

    def knows(self, taps: Taps) -> Truths:
        """Return which taps were used in training or validation, (taps,)."""
        return np.isin(taps.numbers(), self.trained_on)

    def decode(self, taps: Taps | str | Path, *, mm_per_px: float | None = None) -> pd.DataFrame:
        """Decode the angle of each tap; recordings have the scale of the training by default.

        One row per tap: its labels, what is decoded (``psi_deg`` and ``orientation_deg`` for
        gratings, ``edge_deg`` for an edge), ``strength``, the length of the decoded vector, and
        ``trained_on``: tasks refuse a table with taps of the training.
        """
        if not isinstance(taps, Taps):
            scale, rest = self.scale(mm_per_px), self.rest_mm if len(self.rest_mm) else None
            taps = taps_of(taps, stimulus=self.training.network, mm_per_px=scale, rest=rest)[0]
        read = self._read(taps)
        table = taps.labels.assign(**read)
        if "yaw_deg" in table:
            warn_of_angles(table, *(name for name in read if name.endswith("_deg")))
        known = self.knows(taps)
        return table.assign(trained_on=known) if known.any() else table

    def scale(self, mm_per_px: float | None = None) -> float | None:
        """Return a scale of images, that of the training by default; warn if it differs from it."""
        trained: float | None = self.about.get("taps", {}).get("mm_per_px")
        if trained and mm_per_px and not np.isclose(mm_per_px, trained, rtol=1e-3):
            DataWarning.warn(
                f"mm_per_px must be {trained:g}, as in the training of the decoder, got "
                f"{mm_per_px:g}: angles are wrong unless the images have another resolution"
            )
        return trained if mm_per_px is None else mm_per_px

    def _read(self, taps: Taps) -> dict[str, Reals]:
        """Return what the network decodes, by name, (taps,) each."""
        _check_stimulus(taps, self.training)
        known, same = len(self.rest_mm), taps.rest_mm.shape == self.rest_mm.shape
        if known and not (same and np.allclose(taps.rest_mm, self.rest_mm, atol=1e-3)):
            raise InputError(
                f"the decoder needs taps with its {len(self.rest_mm)} pins at the same positions, "
                f"got taps of {len(taps.rest_mm)} pins or at other positions",
                "taps",
            )
        foreign = isinstance(self.training, OwnNetwork)
        kind: Any = self.training if foreign else NETWORKS[self.training.network]
        read: dict[str, Reals] = kind.read(
            _outputs(self.network, _checked_inputs(kind.inputs(taps)))
        )
        return read

    def save(self, path: str | Path) -> Path:
        """Save as .safetensors or .onnx; never leaves a partial file.

        A decoder that was read from an .onnx file cannot be saved.
        """
        path = Path(path)
        _check_ending(path)
        check_writable(path.parent)
        if isinstance(self.network, OnnxNetwork):
            raise InputError(
                "a decoder read from an .onnx file can't be saved again: copy the file", "path"
            )
        header = {"training": asdict(self.training), "history": self.history, "about": self.about}
        store = self._as_onnx if path.suffix == ".onnx" else self._as_safetensors
        with replacing(path) as partial:
            partial.write_bytes(store(header))
        return path

    def _as_safetensors(self, header: dict[str, Any]) -> bytes:
        from safetensors.numpy import save

        arrays = {f"net.{name}": v.numpy() for name, v in self.network.state_dict().items()}
        arrays["rest_mm"] = np.ascontiguousarray(self.rest_mm)
        arrays["trained_on"] = self.trained_on
        return bytes(save(arrays, {"bgmodel": json.dumps(header, sort_keys=True)}))

    def _as_onnx(self, header: dict[str, Any]) -> bytes:
        arrays = {"rest_mm": self.rest_mm.tolist(), "trained_on": self.trained_on.tolist()}
        shape = NETWORKS[self.training.network].shape(len(self.rest_mm))
        return onnx_bytes(self.network, shape, {**header, **arrays})

    @classmethod
    def load(cls, path: str | Path) -> Decoder:
        """Load a decoder from .safetensors or .onnx; neither format contains executable code."""
        path = path_of(path)
        if not path.is_file():
            raise InputError(f"there is no decoder {str(path)!r}", "path", path)
        _check_ending(path)
        try:
            return cls(*(_from_onnx if path.suffix == ".onnx" else _from_safetensors)(path))
        except ImportError:
            raise
        except Exception as error:  # of any class: a header may hold anything
            missing = isinstance(error, KeyError)
            first = str(error).partition("\n")[0] or type(error).__name__
            reason = f"it has no {error}" if missing else first
            raise InputError(
                f"{str(path)!r} does not hold a decoder of this program: {reason}", "path"
            ) from error


def taps_of(
    source: Taps | str | Path,
    *,
    stimulus: str | None = None,
    mm_per_px: float | None = None,
    rest: Reals | None = None,
    pins: int | None = None,
) -> tuple[Taps, dict[str, Any]]:
    """Return taps and their provenance: taps, those of a file (.npz), or of a folder of recordings.

    Recordings need a scale, and are of gratings unless ``stimulus`` is "edge"; ``rest`` and
    ``pins`` are those of ``recordings.read_taps``.
    """
    if isinstance(source, Taps):
        return source, {}
    path = Path(source)
    if not path.is_dir():
        taps, about = Taps.load(path)
        same = stimulus in (None, taps.stimulus)
        if not same:
            raise InputError(f"{path.name} holds taps of a {taps.stimulus}: not {stimulus}", "path")
        return taps, about
    if mm_per_px is None:
        raise InputError("recordings need their scale: mm_per_px, mm per pixel", "mm_per_px")
    from bgmodel.tactile.recordings import read_taps

    what = stimulus or "grating"
    taps = read_taps(path, mm_per_px=mm_per_px, rest=rest, stimulus=what, pins=pins)
    about = {"recordings": path.name, "mm_per_px": mm_per_px, "stimulus": what}
    return taps, {**about, "sha256": recorded(path)["sha256"]}


def train_decoder(
    taps: Taps | str | Path,
    *,
    edge: bool = False,
    mm_per_px: float | None = None,
    seed: int = 0,
    training: Training | None = None,
    device: str = "cpu",
) -> Decoder:
    """Train a decoder on taps, their file, or a folder of recordings.

    Parameters
    ----------
    taps : Taps or path
        Labelled taps, as for ``taps_of``.
    edge : bool
        Whether recordings are of an edge; otherwise they are of gratings.
    mm_per_px : float, optional
        Scale of recordings, mm per pixel.
    seed, device :
        As for ``train``.
    training : Training, optional
        Training options, such as ``dataclasses.replace(EDGE, epochs=2)``, with ``EDGE`` of
        ``bgmodel.tactile.decoder``; by default those tuned for gratings or for an edge.

    Raises
    ------
    ValueError
        As for ``taps_of`` and ``train``.
    """
    labelled, about = taps_of(taps, stimulus="edge" if edge else None, mm_per_px=mm_per_px)
    training = training or (EDGE if labelled.stimulus == "edge" else Training())
    return train(labelled, seed=seed, training=training, about={"taps": about}, device=device)


def load_decoder(
    path: str | Path,
    own: OwnNetwork | None = None,
    *,
    trained_on: Taps | str | Path | None = None,
) -> Decoder:
    """Return a decoder from its file: one that ``save`` wrote, or another network.

    Parameters
    ----------
    path : path
        A .safetensors or .onnx file, as from ``Decoder.save``, or an .onnx file with a network of
        your own, which has one input and one output; the number of taps comes first in both.
    own : OwnNetwork, optional
        What another network takes and gives.
    trained_on : Taps or path, optional
        Taps on which your network was trained, so that they are marked and other pins refused.

    Raises
    ------
    ValueError
        If the file is missing, damaged, or of another kind.
    """
    known = own is None or isinstance(own, OwnNetwork)
    require(known, "own", "must be an OwnNetwork, or None for one that save wrote", own)
    if own is None:
        require(trained_on is None, "trained_on", "has no effect without own", trained_on)
        return Decoder.load(path)
    path = path_of(path)
    if not path.is_file():
        raise InputError(f"there is no decoder {str(path)!r}", "path", path)
    require(path.suffix == ".onnx", "path", "must be an .onnx file for another network", path)
    try:
        network = OnnxNetwork(path.read_bytes())
    except ValueError as error:
        first = str(error).partition("\n")[0]
        raise InputError(f"{str(path)!r} does not hold a network: {first}", "path") from error
    about = {"network": {"file": path.name, "sha256": checksum(path), **asdict(own)}}
    if trained_on is None:
        return Decoder(network, own, np.zeros((0, 2)), [], about)
    taps = taps_of(trained_on, stimulus=own.stimulus)[0]
    return Decoder(network, own, taps.rest_mm, [], about, taps.numbers())


def train(
    taps: Taps,
    *,
    seed: int,
    training: Training | None = None,
    about: dict[str, Any] | None = None,
    device: str = "cpu",
) -> Decoder:
    """Train a decoder on taps labelled with ``yaw_deg``: -90..90 for gratings, -180..180 for edges.

    The seed sets the validation split, initial weights, dropout and order of taps. On the CPU, a
    single thread makes it reproduce the weights; on cuda or mps it does not. ``about`` is the
    provenance of the taps, saved with the weights.
    """
    check_device(device)
    training = Training() if training is None else training
    must = f"must be a Training of {__name__}, such as EDGE"
    require(isinstance(training, Training), "training", must, training)
    _check_stimulus(taps, training)
    kind = NETWORKS[training.network]
    yaw = taps.labels["yaw_deg"].to_numpy(dtype=np.float64)
    low, high = kind.range_deg
    if not ((yaw >= low) & (yaw <= high)).all():
        raise InputError(
            f"yaw_deg must be within {low:g}..{high:g}, got {yaw.min():g}..{yaw.max():g}", "yaw_deg"
        )
    warn_of_angles(taps.labels)
    copies = len(taps) - len(np.unique(taps.numbers()))
    warn_of_copied_taps(copies, len(taps), "the decoder is validated on taps that it was fitted to")
    held = training.held_out(len(taps))
    inputs = _checked_inputs(kind.inputs(taps))
    order = np.random.default_rng(seed).permutation(len(taps))
    fitted, kept = order[held:], order[:held]
    torch = import_torch()
    with _ALONE, torch.random.fork_rng(devices=[]):
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        network = _built(training, taps.rest_mm).to(device)
        try:
            history = _fit(network, training, inputs[fitted], yaw[fitted], inputs[kept], yaw[kept])
        except KeyboardInterrupt:
            raise KeyboardInterrupt("Training was interrupted: no decoder was written.") from None
        finally:
            torch.set_num_threads(threads)
    about = {**provenance(seed), **(about or {})}
    return Decoder(network.cpu(), training, taps.rest_mm, history, about, taps.numbers())


def check_device(device: str) -> None:
    """Raise ValueError if PyTorch cannot train on this device."""
    if device == "cpu":
        return
    torch = import_torch()
    available = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    names = ["cpu", *(name for name, there in available.items() if there)]
    must = f"must be one that PyTorch finds here ({', '.join(names)})"
    require(device in names, "device", must, device)


def _check_ending(path: Path) -> None:
    require(path.suffix in ENDINGS, "path", f"must end in {' or '.join(ENDINGS)}", str(path))


def _from_safetensors(path: Path) -> tuple[Any, ...]:
    """Return the fields of a decoder."""
    torch = import_torch()
    from safetensors import safe_open

    with safe_open(path, framework="pt") as stored:
        header = json.loads((stored.metadata() or {})["bgmodel"])
        tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    training = Training(**header["training"])
    rest_mm = tensors.pop("rest_mm").numpy()
    trained_on = tensors.pop("trained_on").numpy()
    # Without memory: the size that the header gives may be absurd.
    with torch.device("meta"):
        network = _built(training, rest_mm)
    weights = {name[4:]: value for name, value in tensors.items()}
    network.load_state_dict(weights, assign=True)
    return network.eval(), training, rest_mm, header["history"], header["about"], trained_on


def _from_onnx(path: Path) -> tuple[Any, ...]:
    """Return the fields of a decoder, without using PyTorch."""
    network = OnnxNetwork(path.read_bytes())
    header = network.header
    if not header:
        raise ValueError("another network needs what it takes and gives: own")
    training = Training(**header["training"])
    rest_mm = np.array(header["rest_mm"], dtype=np.float64)
    trained_on = np.array(header["trained_on"], dtype=np.int64)
    kind = NETWORKS[training.network]
    expected = [list(kind.shape(len(rest_mm))), [len(kind.weights)]]
    if network.shapes != expected:
        raise ValueError(f"its network must have the shapes {expected}, got {network.shapes}")
    return network, training, rest_mm, header["history"], header["about"], trained_on


def _check_stimulus(taps: Taps, training: Training | OwnNetwork) -> None:
    if taps.stimulus != training.network:
        raise InputError(
            f"this decoder reads taps of one stimulus, {training.network}, got {taps.stimulus}",
            "taps",
        )


def _built(training: Training, rest_mm: Reals) -> Any:
    kind = NETWORKS[training.network]
    return kind.build(kind.shape(len(rest_mm)), training.width, training.dropout)


def _checked_inputs(inputs: Reals) -> Reals:
    if not np.isfinite(inputs).all():
        raise InputError("taps must be finite displacements, got NaN or infinity", "taps")
    return np.ascontiguousarray(inputs, dtype=np.float32)


def _outputs(network: Any, inputs: Reals) -> Reals:
    """Return the outputs (taps, outputs) of a PyTorch or ONNX network."""
    compute = OnnxNetwork.outputs if isinstance(network, OnnxNetwork) else _torch_outputs
    parts = [compute(network, inputs[i : i + BATCH]) for i in range(0, len(inputs), BATCH)]
    return np.concatenate(parts)


def _torch_outputs(network: Any, inputs: Reals) -> Reals:
    network.eval()
    with import_torch().no_grad():
        return np.asarray(network(_tensor(network, inputs)).cpu())


def _tensor(network: Any, values: Reals) -> torch.Tensor:
    """Return values as a single-precision tensor on the network's device."""
    single = np.ascontiguousarray(values, dtype=np.float32)
    return import_torch().from_numpy(single).to(next(network.parameters()).device)


def _fit(
    network: Any, training: Training, inputs: Reals, yaw: Reals, held_inputs: Reals, held_yaw: Reals
) -> list[dict[str, float]]:
    """Train in place, keep the weights with the lowest validation error; return the history."""
    from tqdm import tqdm

    torch = import_torch()
    kind = NETWORKS[training.network]
    set_scale(network, inputs)
    inputs, yaw = kind.augmented(inputs, yaw)
    x, y = _tensor(network, inputs), _tensor(network, kind.targets(yaw))
    steps = -(-len(x) // training.batch) * training.epochs
    optimiser = torch.optim.AdamW(network.parameters(), training.learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, training.learning_rate, total_steps=steps
    )
    best, history = {}, []
    epochs = tqdm(range(training.epochs), desc="training", unit="epoch", disable=None)
    for epoch in epochs:
        loss = _epoch(network, training, kind, x, y, optimiser, schedule)
        errors = kind.errors(kind.read(_outputs(network, held_inputs)), held_yaw)
        history.append({"loss": loss, **errors})
        epochs.set_postfix(mae=f"{errors['mae_deg']:.1f}")
        scores = [row["mae_deg"] for row in history]
        if scores[-1] == min(scores):
            best = copy.deepcopy(network.state_dict())
        elif epoch - int(np.argmin(scores)) >= training.patience:
            break
    network.load_state_dict(best)
    network.eval()
    return history


def _epoch(
    network: Any,
    training: Training,
    kind: Network,
    x: torch.Tensor,
    y: torch.Tensor,
    optimiser: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.OneCycleLR,
) -> float:
    """Train for one pass over the taps; return the mean loss."""
    torch = import_torch()
    weights = torch.tensor(kind.weights, device=y.device)
    dense = [m for m in network if isinstance(m, torch.nn.Linear)][:-1]
    network.train()
    total = 0.0
    for index in torch.randperm(len(x)).split(training.batch):
        if len(index) < 2:  # batch normalisation needs at least two
            continue
        loss = (weights * (network(x[index]) - y[index]) ** 2).mean()
        if training.l2:
            loss = loss + training.l2 * sum((m.weight**2).sum() for m in dense)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        total += loss.item() * len(index)
    return total / len(x)
