"""Models of recorded cells and choices: the likelihood of both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from bgmodel.fitting.cells.density import (
    SUMS,
    Passed,
    Values,
    chosen,
    encoded_by,
    moved,
    p_right,
    passed,
)
from bgmodel.fitting.cells.encoding import Encoding, encoding_of
from bgmodel.fitting.cells.sessions import (
    BIN_S,
    KNOTS,
    LAG_S,
    PAST_S,
    RecordedSession,
    recent,
    seen_share,
    sessions_of,
)
from bgmodel.fitting.design import Design
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.parameters import Parameter, ParameterSpace
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.errors import InputError

SHARED = (
    Parameter("noise", 0.02, 30.0, 5.0, "noise of the cells' sum, clicks per sqrt(s)", scale="log"),
    Parameter("start_noise", 0.02, 20.0, 2.0, "its noise at the onset, clicks", scale="log"),
    Parameter("leak_per_s", -3.0, 20.0, 1.0, "leak of the cells' sum, 1/s"),
    Parameter("deciding_noise", 0.02, 30.0, 5.0, "noise of the sum that decides", scale="log"),
    Parameter("deciding_leak_per_s", -3.0, 20.0, 0.0, "leak of the sum that decides, 1/s"),
    Parameter(
        "deciding_start_noise", 0.02, 20.0, 0.02, "noise of the sum that decides at the onset",
        free=False, scale="log",
    ),
    Parameter("shared_noise", 0.0, 1.0, 1.0, "correlation of the noise of the sums", free=False),
    Parameter("bias", -10.0, 10.0, 0.0, "bias of the choice, clicks"),
    Parameter("lapse", 0.001, 0.4, 0.05, "share of choices at random", scale="log"),
    Parameter(
        "choice_noise", 0.02, 50.0, 0.1, "noise of the choice alone, clicks", free=False,
        scale="log",
    ),
    Parameter("adaptation", 0.0, 1.0, 0.13, "share of its effect to which a click reduces the next",
              free=False),
    Parameter("recovery_s", 0.01, 1.0, 0.1, "time constant of its recovery", free=False),
)  # fmt: skip
"""Parameters that all cells share; those of adaptation are from Brunton et al. (2013)."""
SCALE = Parameter(
    "nats_per_click", 0.005, 5.0, 0.1, "log odds of the two sides per click, nats", scale="log"
)
LEAKY_PER_S = 15.0
"""Leak of the sum of clicks at the second start of a search."""
WARM = 12
"""Iterations of the regression from which a search starts."""
EXPECTED_SETS, EXPECTED_SEED = 4, 74_201
"""Simulated sets, and their seed, from which information is expected."""


@dataclass(frozen=True)
class CellsLikelihood(Likelihood):
    """The likelihood of one person's choices and of the spikes of cells recorded meanwhile.

    The numbers of a fit are shared parameters and, for each cell, its course (``KNOTS`` numbers),
    the effect of its recent rate, and its gain.
    """

    model: RecordedCells
    sessions: tuple[RecordedSession, ...] = ()
    scored: ClassVar[bool] = True

    @cached_property
    def _columns(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.freedom.names)}

    def values(self, vector: Array) -> dict[str, float]:
        """Return all parameters by name."""
        return {name: float(each[0]) for name, each in self.freedom.values(vector).items()}

    def _passed(
        self, vector: Array, free: Sequence[str] | None
    ) -> Iterator[tuple[RecordedSession, Passed]]:
        """Return the sessions with the passes of their trials."""
        values, encoding = self.values(vector), self.model.encoding
        for session in self.sessions:
            yield session, passed(session, values, _cells(session, values), encoding, free)

    def each(self, vector: Array) -> Array:
        """Return the log density of each trial's choice and spikes, nats."""
        return self._ordered([done.log_density for _, done in self._passed(vector, None)])

    def _ordered(self, parts: list[Array]) -> Array:
        """Return values of each session's trials in the order of the trials of the design."""
        order = np.argsort(np.concatenate([each.trials for each in self.sessions]))
        return np.concatenate(parts)[order]

    def choices(self, vector: Array) -> Array:
        """Return the log probability of each choice without regard to spikes, (trials,), nats."""
        values = self.values(vector)
        return self._ordered([np.log(chosen(p_right(s, values), s)) for s in self.sessions])

    def scores(self, vector: Array) -> Array:
        """Return the derivative of each trial's log likelihood, (trials, parameters)."""
        return self.with_scores(vector)[1]

    def with_scores(self, vector: Array) -> tuple[Array, Array]:
        """Return ``each`` and ``scores`` at once."""
        at, shared = self._columns, [each.name for each in self.model.shared]
        parts, log_density = [], []
        for session, done in self._passed(vector, [name for name in shared if name in at]):
            derivatives = np.zeros((len(session.trials), len(at)))
            for name, column in done.shared.items():
                derivatives[:, at[name]] = column
            for cell, columns in zip(session.names, done.cells, strict=True):
                for name, column in zip(numbers_of(cell), columns.T, strict=True):
                    if name in at:
                        derivatives[:, at[name]] = column
            parts.append(derivatives)
            log_density.append(done.log_density)
        return self._ordered(log_density), self._ordered(parts)

    def information(self, vector: Array) -> tuple[Array, tuple[str, ...]]:
        """Return the information that remains where rates are right and their variation is not.

        Spikes of a trial go together more than the model says, so that derivatives of recorded
        trials vary more than those of simulated ones, by B and F: the covariance of the numbers is
        F^-1 B F^-1 (White 1982).
        """
        recorded, still = super().information(vector)
        sets = (self._drawn(vector, stream(EXPECTED_SEED, k)) for k in range(EXPECTED_SETS))
        scores = np.concatenate([each.scores(vector) for each in sets])
        expected = scores.T @ scores / EXPECTED_SETS
        return expected @ np.linalg.pinv(recorded, hermitian=True) @ expected, still

    def _drawn(self, vector: Array, rng: np.random.Generator) -> Self:
        """Return the likelihood of new choices and counts of spikes in the same trials."""
        sessions = []
        values, encoding = self.values(vector), self.model.encoding
        for session in self.sessions:
            choice, counts, past = drawn(session, values, encoding, rng)
            sessions.append(replace(session, choice=choice, counts=counts, past=past))
        return replace(self, sessions=tuple(sessions))

    def part(self, trials: Array | Integers) -> Self:
        """Return the likelihood of a subset of the trials."""
        every = np.sort(np.concatenate([each.trials for each in self.sessions]))
        kept = every[np.asarray(trials)]
        parts = [each.where(np.isin(each.trials, kept)) for each in self.sessions]
        return replace(
            self, design=self.design.part(trials),
            sessions=tuple(each for each in parts if len(each.trials)),
        )  # fmt: skip

    @property
    def groups(self) -> Integers:
        """Session of each trial."""
        session_of = [np.full(len(each.trials), k) for k, each in enumerate(self.sessions)]
        return self._ordered(session_of).astype(np.int64)

    def density(self, vector: Array) -> Array:
        """Return the predicted density of choices at the end of their clicks, (1, 2, bins), 1/s."""
        values, grid = self.values(vector), self.design.grid
        mass = np.zeros((2, grid.bins))
        for session in self.sessions:
            right = p_right(session, values)
            bins = np.minimum((session.end_s / grid.width_s).astype(np.int64), grid.bins - 1)
            answered = session.choice >= 0
            for response, p in enumerate((1 - right, right)):
                np.add.at(mass[response], bins[answered], p[answered])
        return np.asarray(mass[None] / (self.design.trials.sum() * grid.width_s))

    def starts(self) -> list[Array]:
        """Return starts of a search: with a sum of clicks that hardly leaks, and a leaky one.

        From one of them alone, a search in a few hundred trials may end at a lower peak.
        """
        start, at = self.freedom.start, self._columns
        if "leak_per_s" not in at:
            return [self._begun(start)]
        leaky = start.copy()
        leaky[at["leak_per_s"]] = LEAKY_PER_S
        return [self._begun(leaky), self._begun(start)]

    def _begun(self, shared: Array) -> Array:
        """Return a start in which each cell's numbers are from its regression on the sum."""
        start, at = shared.copy(), self._columns
        values = self.values(start)
        for session in self.sessions:
            for cell, numbers in zip(session.names, self._regressed(session, values), strict=True):
                for name, number in zip(numbers_of(cell), numbers, strict=True):
                    if name in at:
                        k = at[name]
                        start[k] = np.clip(number, self.freedom.low[k], self.freedom.high[k])
        return start

    def _regressed(self, session: RecordedSession, values: Values) -> list[Array]:
        """Return each cell's numbers without noise of the sum: Poisson regression, by scoring."""
        on, encoding = session.on, self.model.encoding
        sums = session.sums(*(values[name] for name in SUMS))[:, :-1]
        read = encoded_by(encoding, values, sums)[0][on]
        basis = np.broadcast_to(session.basis, (*on.shape, KNOTS))[on]
        per_cell = []
        for name, count, past in zip(session.names, session.counts, session.past, strict=True):
            design, spikes = np.column_stack([basis, past[on], read]), count[on]
            mean = max(float(spikes.mean()) / BIN_S, 0.1)
            free = np.array([each in self._columns for each in numbers_of(name)])
            guess = np.append(np.full(KNOTS, np.log(mean)), [0.0, 0.0])
            numbers = np.where(free, guess, [values[each] for each in numbers_of(name)])
            for _ in range(WARM):
                base, drive = design[:, :-1] @ numbers[:-1], numbers[-1] * read
                _, rate, rise = encoding.rate(base, drive)
                moved = free * np.column_stack([design[:, :-1], rise * read])
                curve = BIN_S * (moved.T * rate) @ moved + 0.1 * np.eye(len(numbers))
                step = np.linalg.solve(curve, moved.T @ (spikes - BIN_S * rate))
                numbers = numbers + np.clip(step, -1, 1)
            per_cell.append(numbers)
        return per_cell

    def simulated(self, vector: Array, rng: np.random.Generator) -> Trials:
        """Return all trials of the person with new choices and spikes."""
        trials = self.design.choices
        if trials is None or trials.spikes is None or (read := trials.readings) is None:
            raise InputError("trials are simulated for a design with its choices", "design")
        values, choice = self.values(vector), np.array(read.choice)
        spikes = trials.spikes
        place = {name: k for k, name in enumerate(spikes.names)}
        made = [spikes.time_s[spikes.time_s < LAG_S]]
        of = [np.stack([spikes.trial, spikes.cell])[:, spikes.time_s < LAG_S]]
        for session in self.sessions:
            choice[session.trials], counts, _ = drawn(session, values, self.model.encoding, rng)
            for name, each in zip(session.names, counts.astype(np.int64), strict=True):
                at = np.argwhere(each > 0)
                many = np.repeat(at, each[each > 0], axis=0)
                made.append(LAG_S + BIN_S * (many[:, 1] + rng.random(len(many))))
                of.append(np.stack([session.trials[many[:, 0]], np.full(len(many), place[name])]))
        trial, cell = np.concatenate(of, axis=1)
        new = replace(spikes, trial=trial, cell=cell, time_s=np.concatenate(made))
        response = np.where(choice < 0, -1, choice == 1).astype(np.int8)
        readings = replace(read, choice=choice)
        return replace(trials, response=response, readings=readings, spikes=new)


def drawn(
    session: RecordedSession, values: Values, encoding: Encoding, rng: np.random.Generator
) -> tuple[Integers, Array, Array]:
    """Return new choices (trials,), and counts and past of each cell, (cells, trials, bins)."""
    count, bins = session.counts.shape[1:]
    sums = session.sums(*(values[name] for name in SUMS))
    n, past_s = np.asarray(values["start_noise"] * rng.standard_normal(count)), 0.0
    edges_s = np.asarray(np.arange(bins) * BIN_S + LAG_S, np.float64)
    share = seen_share(edges_s)
    level = [(np.expm1(past[:, 0] - recent(np.zeros(1)))) * share[0] for past in session.past]
    counts, pasts = np.zeros(session.counts.shape), np.zeros(session.counts.shape)
    final, numbers = np.empty(count), _cells(session, values)
    for k in range(bins + 1):
        last = session.bins == k
        if last.any():
            left, added = moved(
                values["leak_per_s"], values["noise"], np.maximum(session.end_s - past_s, 0.0)
            )
            final = np.where(last, left * n + np.sqrt(added) * rng.standard_normal(count), final)
        if k == bins:
            break
        left, added = moved(values["leak_per_s"], values["noise"], session.middles_s[k] - past_s)
        n, past_s = (
            left * n + np.sqrt(added) * rng.standard_normal(count),
            float(session.middles_s[k]),
        )
        read = encoded_by(encoding, values, sums[:, k] + n)[0]
        cells = zip(level, numbers, counts[:, :, k], pasts[:, :, k], strict=True)
        for activity, cell, now, past in cells:
            past[:] = recent(activity / share[k])
            base = session.basis[k] @ cell[:-2] + cell[-2] * past
            rate = encoding.rate(base, cell[-1] * read)[1]
            now[:] = rng.poisson(rate * BIN_S) * session.on[:, k]
            activity *= np.exp(-BIN_S / PAST_S)
            activity += now * np.exp(-BIN_S / 2 / PAST_S) / PAST_S
    right = p_right(session, values, final[:, None], np.zeros(count))[:, 0]
    choice = (rng.random(count) < right).astype(np.int64)
    return np.where(session.choice < 0, -1, choice), counts, pasts


def _cells(session: RecordedSession, values: Values) -> list[Array]:
    """Return the numbers of each cell."""
    return [np.array([values[each] for each in numbers_of(cell)]) for cell in session.names]


def numbers_of(cell: str) -> list[str]:
    """Return the names of a cell's numbers in the order of ``density.passed``."""
    return [*(f"{cell} course {k + 1}" for k in range(KNOTS)), f"{cell} past", f"{cell} gain"]


@dataclass(frozen=True, eq=False)
class RecordedCells:
    """Cells recorded with choices, which all encode one noisy sum of clicks in the same way."""

    encoding: Encoding
    trials: Trials  # of one person, with spikes

    @property
    def name(self) -> str:
        """Name of the encoding."""
        return self.encoding.name

    @property
    def shared(self) -> tuple[Parameter, ...]:
        """Parameters of the sum and of the choice."""
        return (*SHARED, SCALE) if self.encoding.scaled else SHARED

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: shared ones and those of each cell."""
        cells = []
        for cell in dict.fromkeys(x for each in sessions_of(self.trials) for x in each.names):
            *course, past, gain = numbers_of(cell)
            cells += [Parameter(x, -15.0, 15.0, 1.0, "log of Hz", prior=(1.0, 3.0)) for x in course]
            cells += [Parameter(x, -15.0, 15.0, 0.0, "", prior=(0.0, 1.0)) for x in (past, gain)]
        return (*self.shared, *cells)

    def identity(self) -> dict[str, Any]:
        """Return all that its predictions depend on; see ``likelihood.identity_of``."""
        return self.encoding.identity()

    def likelihood(self, design: Design, freedom: ParameterSpace) -> CellsLikelihood:
        """Return the likelihood of all trials."""
        return CellsLikelihood(self, design, freedom, sessions_of(self.trials))


def cells_model(name: Any, trials: Trials) -> RecordedCells:
    """Return the model of a name on one person's trials."""
    if isinstance(name, Circuit):
        raise InputError.of("models", "must name a nucleus too, such as 'macaque D1'", name.name)
    return RecordedCells(encoding_of(str(name) if isinstance(name, Path) else name), trials)
