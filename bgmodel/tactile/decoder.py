"""The convolutional network that reads a grating's angle from a tap (Pestell et al. 2022)."""

from __future__ import annotations

import copy
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bgmodel.tables import check_writable, provenance

if TYPE_CHECKING:
    import torch

FloatArray = npt.NDArray[np.floating]
SIDE = 19


@dataclass(frozen=True)
class Training:
    """How the decoder is built and trained."""

    width: float = 0.25
    """Filters and units as a share of the source study's; 1 is Pestell et al. 2022, .25 our
    choice for speed."""
    epochs: int = 30
    """Most passes over the taps; assumed (the source stops early within hundreds)."""
    patience: int = 8
    """Epochs without a better validation error before stopping; 20 in Pestell et al. 2022."""
    batch: int = 32
    """Taps a step; Pestell et al. 2022."""
    learning_rate: float = 1e-3
    """RMSprop step size; 1e-4 in Pestell et al. 2022, raised with the smaller network; assumed."""
    l2: float = 0.005
    """Weight decay of the two dense layers; Pestell et al. 2022."""
    validation: float = 0.25
    """Share of taps kept for validation, whole taps; 2 016 of 8 000 in Pestell et al. 2022."""

    def __post_init__(self) -> None:
        for name in ("width", "learning_rate"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be > 0, got {getattr(self, name)}")
        for name in ("epochs", "patience", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not 0 < self.validation < 1:
            raise ValueError(f"validation must lie between 0 and 1, got {self.validation}")


@dataclass
class Decoder:
    """A trained network.

    Parameters
    ----------
    network : torch.nn.Module
        Takes maps (taps, 1, 19, 19), gives (taps, 3): label, cos 2 yaw, sin 2 yaw.
    training : Training
        How it was trained.
    history : list of dict
        Per epoch: training loss and validation errors, degrees.
    about : dict
        Provenance: of the taps and of the training.
    """

    network: Any
    training: Training
    history: list[dict[str, float]]
    about: dict[str, Any]

    def decode(self, maps: FloatArray, batch: int = 4096) -> dict[str, FloatArray]:
        """Read the angle of each tap.

        Parameters
        ----------
        maps : array (taps, 1, 19, 19)
            z-scored maps, as from ``Taps.maps()``.

        Returns
        -------
        dict of arrays (taps,)
            ``psi_deg``: the linear head, clipped to -90..90; ``orientation_deg``: the
            double-angle head, in -90..90; ``strength``: length of the double-angle vector.
        """
        torch = _torch()
        maps = checked_maps(maps)
        self.network.eval()
        with torch.no_grad():
            parts = [
                self.network(torch.from_numpy(maps[i : i + batch])).numpy()
                for i in range(0, len(maps), batch)
            ]
        label, cosine, sine = np.concatenate(parts).astype(np.float64).T
        return {
            "psi_deg": np.clip(180 * label - 90, -90, 90),
            "orientation_deg": np.degrees(np.arctan2(sine, cosine)) / 2,
            "strength": np.hypot(cosine, sine),
        }

    def save(self, path: str | Path) -> Path:
        """Store weights and all that is needed to use them again, whole or not at all."""
        from safetensors.numpy import save

        path = Path(path)
        check_writable(path.parent)
        arrays = {name: value.numpy() for name, value in self.network.state_dict().items()}
        header = {"training": asdict(self.training), "history": self.history, "about": self.about}
        partial = path.with_name(path.name + ".partial")
        partial.write_bytes(save(arrays, {"bgmodel": json.dumps(header, sort_keys=True)}))
        partial.replace(path)
        return path

    @classmethod
    def load(cls, path: str | Path) -> Decoder:
        """Read a stored decoder; nothing in the file is ever run.

        Raises
        ------
        ValueError
            If the file is absent, not a decoder, cut short, or of another shape.
        """
        torch = _torch()
        from safetensors import SafetensorError, safe_open

        path = Path(path)
        if not path.is_file():
            raise ValueError(f"there is no decoder {str(path)!r}")
        try:
            with safe_open(path, framework="pt") as stored:
                header = json.loads((stored.metadata() or {})["bgmodel"])
                weights = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
            network = build_network(header["training"]["width"])
            network.load_state_dict(weights)
        except (SafetensorError, KeyError, TypeError, RuntimeError, ValueError) as error:
            raise ValueError(
                f"{str(path)!r} does not hold a decoder of this program: {error}"
            ) from error
        network.to(torch.float32)
        return cls(network, Training(**header["training"]), header["history"], header["about"])


def build_network(width: float = 1.0) -> torch.nn.Sequential:
    """Return the source study's network, its layers scaled by ``width``, with three outputs."""
    nn = _torch().nn
    c1, c2 = max(1, round(64 * width)), max(1, round(128 * width))

    def norm(n: int, flat: bool = False):
        return (nn.BatchNorm1d if flat else nn.BatchNorm2d)(n, eps=1e-3, momentum=0.01)

    def dense(n_in: int, n_out: int):
        return [nn.Linear(n_in, n_out), nn.ReLU(), norm(n_out, flat=True), nn.Dropout(0.2)]

    return nn.Sequential(
        *[nn.Conv2d(1, c1, 3, padding="same"), nn.ReLU(), nn.MaxPool2d(2), norm(c1)],
        *[nn.Conv2d(c1, c2, 3, padding="same"), nn.ReLU(), norm(c2)],
        *[nn.Conv2d(c2, c2, 3), nn.ReLU(), norm(c2), nn.MaxPool2d(2), norm(c2)],
        *[nn.Flatten(), nn.Dropout(0.4)],
        *dense(9 * c2, 32),
        *dense(32, 16),
        nn.Linear(16, 3),
    )


def targets(yaw_deg: FloatArray) -> FloatArray:
    """Return what the heads should say: (taps, 3) of (yaw + 90)/180, cos 2 yaw, sin 2 yaw."""
    double = np.radians(2 * np.asarray(yaw_deg))
    columns = [(np.asarray(yaw_deg) + 90) / 180, np.cos(double), np.sin(double)]
    return np.stack(columns, axis=1).astype(np.float32)


def train(
    maps: FloatArray,
    yaw_deg: FloatArray,
    *,
    seed: int,
    training: Training | None = None,
    about: dict[str, Any] | None = None,
) -> Decoder:
    """Train a decoder on one thread, so that a seed gives the same weights again.

    Parameters
    ----------
    maps : array (taps, 1, 19, 19)
        z-scored maps.
    yaw_deg : array (taps,), degrees
        True yaw, -90..90.
    seed : int
        Of the split, the weights, the dropout and the order.
    training : Training
        Options.
    about : dict
        Provenance of the taps, stored with the weights.

    Raises
    ------
    ValueError
        If maps or yaws are of the wrong shape, not finite, or too few to split.
    """
    training = training or Training()
    maps, yaw = checked_maps(maps), np.asarray(yaw_deg, dtype=np.float64)
    if yaw.shape != (len(maps),) or not (np.abs(yaw) <= 90).all():
        raise ValueError(f"yaw_deg must hold {len(maps)} angles in -90..90, got {yaw.shape}")
    held = round(training.validation * len(maps))
    if held < 1 or len(maps) - held < 2 * training.batch:
        raise ValueError(
            f"training needs at least {2 * training.batch} taps beside those for validation, "
            f"got {len(maps)} in all"
        )
    order = np.random.default_rng(seed).permutation(len(maps))
    split = (order[held:], order[:held])
    torch = _torch()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        network, history = _fit(torch, maps, yaw, split, seed, training)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("training was interrupted: no decoder was written") from None
    finally:
        torch.set_num_threads(threads)
    return Decoder(network, training, history, {**provenance(seed), **(about or {})})


def checked_maps(maps: FloatArray) -> FloatArray:
    """Return maps (taps, 1, 19, 19) as float32; ValueError if they are anything else."""
    maps = np.asarray(maps)
    if maps.ndim != 4 or maps.shape[1:] != (1, SIDE, SIDE) or len(maps) == 0:
        raise ValueError(
            f"maps must have shape (taps, 1, {SIDE}, {SIDE}) with at least one tap, "
            f"got {maps.shape}"
        )
    if maps.dtype.kind != "f" or not np.isfinite(maps).all():
        raise ValueError(f"maps must be finite floating-point numbers, got {maps.dtype}")
    return np.ascontiguousarray(maps, dtype=np.float32)


def _fit(torch, maps, yaw, split, seed, training):
    from tqdm import tqdm

    torch.manual_seed(seed)
    network = build_network(training.width)
    optimiser = torch.optim.RMSprop(network.parameters(), training.learning_rate, alpha=0.9)
    inputs, wanted = torch.from_numpy(maps), torch.from_numpy(targets(yaw))
    fitted, held = map(torch.from_numpy, split)
    dense = [m for m in network if isinstance(m, torch.nn.Linear)][:-1]
    best, best_error, since, history = None, np.inf, 0, []
    epochs = tqdm(range(training.epochs), desc="training", unit="epoch", disable=None)
    for _ in epochs:
        network.train()
        losses = []
        for index in fitted[torch.randperm(len(fitted))].split(training.batch):
            if len(index) < 2:
                continue
            loss = torch.nn.functional.mse_loss(network(inputs[index]), wanted[index])
            loss = loss + training.l2 * sum((m.weight**2).sum() for m in dense)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
        errors = _validation(torch, network, inputs[held], yaw[split[1]])
        history.append({"loss": float(np.mean(losses)), **errors})
        epochs.set_postfix(mae=f"{errors['mae_deg']:.1f}")
        if errors["mae_deg"] < best_error:
            best, best_error, since = copy.deepcopy(network.state_dict()), errors["mae_deg"], 0
        elif (since := since + 1) >= training.patience:
            break
    network.load_state_dict(best)
    return network.eval(), history


def _validation(torch, network, inputs, yaw):
    network.eval()
    with torch.no_grad():
        label, cosine, sine = network(inputs).numpy().astype(np.float64).T
    linear = np.abs(np.clip(180 * label - 90, -90, 90) - yaw)
    double = np.abs((np.degrees(np.arctan2(sine, cosine)) / 2 - yaw + 90) % 180 - 90)
    return {"mae_deg": float(linear.mean()), "orientation_mae_deg": float(double.mean())}


def _torch():
    try:
        import torch
    except ImportError as error:
        raise ImportError('the decoder needs PyTorch: pip install "bgmodel[tactile]"') from error
    return torch
