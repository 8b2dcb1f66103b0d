"""The command that holds tests and circuits to choices and times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from bgmodel import files
from bgmodel.commands.checks import (
    UNRECORDED,
    Shows,
    check_whole,
    circuit_file,
    recorded,
    say,
)
from bgmodel.commands.fitted import TABLES, Kept
from bgmodel.commands.names import CircuitName
from bgmodel.version import __version__

if TYPE_CHECKING:
    from bgmodel.fitting.algorithms import Model
    from bgmodel.fitting.design import Design
    from bgmodel.fitting.optimum import Likelihood
    from bgmodel.tables.choices import Choices

GAPS = {"constant_gap": False, "falling_gap": True}


@dataclass(frozen=True)
class FitRun(Shows):
    """Fit models to choices and times: the sequential test, and a circuit beside it.

    DATA is a shipped set (see `bgmodel data`) or a table of your own: participant_id, rt (s),
    response, conditions. For each participant and model it prints what these trials can tell
    apart, and at the end the parameters under which they are most likely. Simulated trials and
    finished fits are kept in the folder: the same command goes on where it was stopped.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary criterion=instruction;
    bgmodel fit mine.csv --strength contrast --criterion onset_stn --posterior
    """

    data: Positional[str]
    """Name of a shipped set, or a .csv, .tsv or .parquet file."""
    folder: Positional[Path | None] = None
    """Where results go; if left out, fits/ and the name of the data."""
    models: tuple[str, ...] = ("constant_gap", "macaque")
    """Models: constant_gap, falling_gap, or a circuit, by its name or as a .toml file."""
    strength: str | None = None
    """Column of the signed strength of the evidence: positive speaks for response 1."""
    participant: str | None = None
    """The participant to fit; if left out, each is fitted separately."""
    pooled: bool = False
    """Fit all participants as if they were one."""
    upper: str | None = None
    """Name of the response that is 1, where responses are not 1 and 0."""
    deadline: float | None = None
    """Time at which a trial without a response ended, s."""
    rt_window: tuple[float, float] | None = None
    """Earliest and latest response time to fit, s; "0 inf" keeps all. If left out and there is no
    deadline, times end at the upper quartile plus 25 interquartile ranges. The command says how
    many trials are left out."""
    criterion: str = "threshold"
    """What sets a circuit's criterion: threshold, dopamine, stn_loss or gpe_loss; or, with a
    threshold, what changes within a trial: rising_dopamine or onset_stn."""
    free: tuple[str, ...] = ()
    """All parameters to fit; if left out, every one but a threshold that --criterion replaces."""
    hold: tuple[str, ...] = ()
    """Parameters to hold at a value, as "lapse=0.02"."""
    vary: tuple[str, ...] = ()
    """Parameters that differ between levels of a column: "sensitivity=conflict",
    "criterion=instruction"; "stn_loss=stimulation/off" holds stn_loss at its start in level off."""
    posterior: bool = False
    """Draw from the posterior too: adds intervals that hold .9 of it."""
    engine: str = "population"
    """How the circuit is computed: algebra, population, ensemble, ..."""
    noise_nats: float = 2.0
    """Noise of the evidence in the circuit: its standard deviation after one second, nats."""
    trials: int = 16_000
    """Number of simulated trials of the circuit, at each of seven drifts."""
    seed: int = 24_001
    """Seed of the simulated trials."""

    def __call__(self) -> None:
        """Run the command."""
        _need()
        from bgmodel.fitting.design import design_of

        check_whole(trials=self.trials)
        self._check_names()
        columns = sorted({each.partition("/")[0] for each in self._vary.values()})
        choices = self._read(columns)
        folder = self.folder or Path("fits") / Path(self.data).stem
        people: list[tuple[str, Choices]] = [(self.participant or "all", choices)]
        if not self.pooled:
            people = [(who, choices.where(choices.participant == who)) for who in choices.people()]
        designs = {
            who: design_of(some, columns, rt_window=self.rt_window, pooled=self.pooled)
            for who, some in people
        }
        seconds = _seconds(designs.values())
        models = {name: self._model(name, seconds, folder) for name in self.models}
        self._check_parameters(models)
        kept = Kept(
            folder, self.seed, self._asked(), _circuits(models),
            self.posterior, self.note,
        )  # fmt: skip
        kept.check(self.force)
        # All of them before any is fitted: what is wrong is said at once.
        asked = {
            who: {name: self._likelihood(design, each) for name, each in models.items()}
            for who, design in designs.items()
        }
        self.note(choices.summary())
        try:
            made = [kept.person(who, some, asked[who]) for who, some in people]
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "Finished fits and simulated trials are kept: the same command goes on from there."
            ) from None
        found = [each for person in made for each in person]
        parameters = kept.gather(found)
        self.show("\n" + parameters.round(4).to_string(index=False), parameters)
        self.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")

    def _check_names(self) -> None:
        """Raise ValueError for a model, an engine or a criterion that there is not."""
        from bgmodel.fitting.criteria import CRITERIA
        from bgmodel.integrators.basal_ganglia import check_engine

        check_engine(self.engine)
        if not 0 < self.noise_nats < float("inf"):
            raise ValueError(f"noise_nats must be finite and above 0, got {self.noise_nats:g}")
        if not self.models:
            raise ValueError("models must name at least one")
        for name in self.models:
            if name not in GAPS and not circuit_file(name) and name not in CircuitName.known():
                allowed = ", ".join((*GAPS, *CircuitName.known()))
                raise ValueError(f"models must be of {allowed}, or .toml files, got {name!r}")
        if self.criterion not in CRITERIA:
            allowed = ", ".join(CRITERIA)
            raise ValueError(f"criterion must be one of {allowed}, got {self.criterion!r}")

    def _check_parameters(self, models: dict[str, Model]) -> None:
        """Raise ValueError for a parameter that none of the models has; say which one lacks it."""
        known = {each.name: 0 for model in models.values() for each in model.parameters}
        for option, names in (("free", self.free), ("hold", self._hold), ("vary", self._vary)):
            for name in names:
                if name not in known and name != "criterion":
                    there = ", ".join(("criterion", *known))
                    raise ValueError(
                        f"{option} must name a parameter, one of {there}, got {name!r}"
                    )
        for name, model in models.items():
            own = {each.name for each in model.parameters} | {"criterion"}
            lacking = ", ".join(each for each in self.free if each not in own)
            if lacking:
                say(
                    f"{name} has no {lacking}, so that what --free leaves out is held in it; "
                    "'criterion' is each model's own"
                )

    def _asked(self) -> dict[str, Any]:
        """Return all that two fits of one folder must share: whose they are, they need not."""
        own = ("data", "folder", "models", "participant", "posterior", *UNRECORDED)
        named = {each.name for each in fields(self)} - set(own)
        said = {name: recorded(getattr(self, name)) for name in sorted(named)}
        if self.rt_window is not None:
            # As text, since JSON has no infinity.
            said["rt_window"] = [f"{time:g}" for time in self.rt_window]
        simulated = {"simulated_trials": said.pop("trials"), "simulation_seed": self.seed}
        # Of the whole table: participants may be fitted one after the other.
        file = Path(self.data)
        trials = files.checksum(file) if file.is_file() else self.data
        version = {"bgmodel": __version__}
        return {"data": self.data, "trials": trials, **simulated, **said, **version}

    @property
    def _vary(self) -> dict[str, str]:
        return dict(_pair(each, "vary") for each in self.vary)

    @property
    def _hold(self) -> dict[str, float]:
        return {name: _number(*pair) for name, *pair in (_pair(h, "hold") for h in self.hold)}

    def _read(self, columns: list[str]) -> Choices:
        from bgmodel.tables.choices import read_choices

        return read_choices(
            self.data,
            strength=self.strength,
            conditions=columns,
            participant=self.participant,
            deadline_s=self.deadline,
            upper=self.upper,
        )

    def _model(self, name: str, seconds: float, folder: Path) -> Model:
        from bgmodel.fitting.algorithms import GapModel
        from bgmodel.fitting.circuit import CircuitModel
        from bgmodel.fitting.criteria import CRITERIA

        if name in GAPS:
            return GapModel(GAPS[name])
        return CircuitModel(
            _circuit(name),
            self.engine,
            CRITERIA[self.criterion],
            noise_nats=self.noise_nats,
            seconds=seconds,
            trials=self.trials,
            seed=self.seed,
            folder=folder / "stored",
        )

    def _likelihood(self, design: Design, model: Model) -> Likelihood:
        from bgmodel.fitting.optimum import likelihood_of

        known = {each.name for each in model.parameters}

        def own(name: str) -> str:
            return model.criterion_name if name == "criterion" else name

        # A parameter that another of the models has says nothing to this one.
        hold = {own(k): v for k, v in self._hold.items()}
        vary = {own(k): v for k, v in self._vary.items()}
        return likelihood_of(
            model,
            design,
            free=[own(each) for each in self.free if own(each) in known] or None,
            fixed={k: v for k, v in hold.items() if k in known},
            vary={k: v for k, v in vary.items() if k in known},
        )


def _need() -> None:
    try:
        import cma  # noqa: F401
        import emcee  # noqa: F401
    except ImportError as error:
        raise ImportError('fits need cma and emcee: pip install ".[fit]"') from error


def _seconds(designs: Iterable[Design]) -> float:
    """Return the length of simulated trials, s: that of the longest trial that is fitted.

    In whole half seconds, so that participants share what is simulated.
    """
    import numpy as np

    seen = [design.observed for design in designs]
    longest = max(each.deadline_s or float(np.nanmax(each.rt_s)) for each in seen)
    return float(np.ceil(2 * longest) / 2)


def _circuits(models: Mapping[str, Model]) -> dict[str, str]:
    """Return the hash of each model's circuit, of those that have one."""
    made = {name: model.identity().get("circuit") for name, model in models.items()}
    return {name: each["sha256"] for name, each in made.items() if isinstance(each, dict)}


def _circuit(name: str) -> Any:
    from circuits.anatomy import circuit

    return circuit(CircuitName.parse(name), 2)


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not value:
        example = "lapse=0.02" if option == "hold" else "criterion=instruction"
        example = f"{option} is a name, =, and a value, as {example}"
        raise ValueError(f"{example}, got {text!r}")
    return name.strip(), value.strip()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"hold must give a number, as lapse=0.02, got {text!r}") from None
