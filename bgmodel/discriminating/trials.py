"""Trials of both models on the same evidence with the same noise, each kind simulated once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.discriminating.information import COMPETITOR, CORRECT, MISSED, OTHER, Recorded
from bgmodel.discriminating.models import Model
from bgmodel.discriminating.recording import Recording
from bgmodel.discriminating.space import Probe, Space
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream
from circuits.errors import InputError

TUNING_TRIALS, TUNING_READINGS = 1000, 120
"""Trials by which thresholds are matched, and readings in each."""
RIVALS = np.round(np.arange(-0.12, 0.125, 0.01), 2)
"""Differences in accuracy over which a free threshold is sought."""


@dataclass(frozen=True)
class Simulated:
    """Decisions of one model in one kind of trials, at many thresholds."""

    tradeoff: Tradeoff
    truth: Integers
    channels: int
    conflict: bool
    jitter_ms: Array
    spikes: Integers | None = None

    def at(self, level: float, deadline_ms: float) -> Recorded:
        """Return choices and times at a threshold, with a deadline."""
        k = int(np.argmin(np.abs(self.tradeoff.settings - level)))
        found = self.tradeoff.choices(k)
        choice = np.where(found.choice == self.truth, CORRECT, OTHER)
        if self.conflict:
            rival = found.choice == (self.truth + 1) % self.channels
            choice[rival] = COMPETITOR
        missed = self.tradeoff.forced[k] | ~(found.time_ms <= deadline_ms)
        choice[missed] = MISSED
        return Recorded(choice, found.time_ms + self.jitter_ms, self.spikes)


@dataclass(frozen=True)
class Trials:
    """Simulated trials of two models in a space of tasks."""

    models: tuple[Model, Model]
    space: Space
    seed: int
    trials: int
    free: bool = False
    workers: int = 1
    recording: Recording | None = None
    kept: dict[Any, Any] = field(default_factory=dict, repr=False)

    def levels(self, k: int, probe: Probe) -> dict[float, float]:
        """Return a model's thresholds by the accuracy that it has in plain trials.

        Accuracies are those of the space and, if thresholds are free, others around them;
        accuracies that it does not reach are missing.
        """
        key = "levels", k, probe.channels, probe.d_prime
        if key not in self.kept:
            rng = stream(self.seed, "discriminate", "tuning", probe.channels, probe.d_prime)
            evidence = gaussian_evidence(
                TUNING_TRIALS, d_prime=probe.d_prime, channels=probe.channels,
                t_max=TUNING_READINGS, step_ms=self.space.step_ms, seed=rng,
            )  # fmt: skip
            swept = self.models[k].swept(evidence, seed=self._noise("tuning"), workers=self.workers)
            self.kept[key] = {
                accuracy: float(swept.at_accuracy(accuracy).settings[0])
                for accuracy in self._accuracies()
                if swept.reaches(accuracy)
            }
            self.kept["gain", *key[1:]] = self.models[k].gain_on(evidence)
        found: dict[float, float] = self.kept[key]
        return found

    def _accuracies(self) -> list[float]:
        given = np.asarray(self.space.accuracy)
        if self.free:
            given = np.union1d(given, np.round(given[:, None] + RIVALS, 4))
        return [float(a) for a in given if 0 < a < 1]

    def simulated(self, k: int, probe: Probe) -> Simulated:
        """Return the decisions of a model in one kind of trials."""
        key = "trials", k, probe
        if key not in self.kept:
            self.kept[key] = self._run(k, probe)
        found: Simulated = self.kept[key]
        return found

    def _run(self, k: int, probe: Probe) -> Simulated:
        levels = np.array(list(self.levels(k, probe).values()))
        if not levels.size:
            asked = ", ".join(f"{a:g}" for a in self.space.accuracy)
            said = f"{self.models[k].name} does not reach an accuracy of {asked} by evidence"
            raise InputError(said, "accuracy")
        kind = "plain" if probe == probe.plain else "probe"
        names = ("discriminate", kind, probe.channels, probe.d_prime)
        # Evidence with and without conflict differs in one mean alone.
        evidence = gaussian_evidence(
            self.trials, d_prime=probe.d_prime, channels=probe.channels, t_max=self.space.readings,
            step_ms=self.space.step_ms, conflict=probe.conflict, seed=stream(self.seed, *names),
        )  # fmt: skip
        run: dict[str, Any] = {
            "edits": probe.lines, "stop": (probe.stop_nats, self.space.stop_delay_ms),
            "gain": self.kept.get(("gain", k, probe.channels, probe.d_prime)),
            "seed": self._noise(kind), "workers": self.workers,
        }  # fmt: skip
        decided = self.models[k].decided(evidence, levels, **run)
        spikes = None
        if self.recording is not None:
            rng = stream(self.seed, *names, "spikes")
            spikes = self.models[k].spikes(evidence, self.recording, rng, **run)
        sd = self.space.non_decision_sd_ms
        jitter = sd * stream(self.seed, *names, "non-decision").standard_normal(self.trials)
        assert evidence.truth is not None
        return Simulated(
            decided, evidence.truth, probe.channels, probe.conflict > 0, jitter, spikes
        )

    def _noise(self, kind: str) -> int:
        """Return the seed of the noise of cells in one kind of trials."""
        return int(stream(self.seed, "discriminate", "noise", kind).integers(2**31))
