"""The command that holds tests and circuits to choices and times."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from bgmodel import files
from bgmodel.commands.checks import Shows, check_whole, recorded, say
from bgmodel.commands.names import CircuitName

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.algorithms import Model
    from bgmodel.fitting.fit import Fit
    from bgmodel.fitting.optimum import Likelihood
    from bgmodel.tables.choices import Choices

GAPS = {"constant_gap": False, "falling_gap": True}


@dataclass(frozen=True)
class FitRun(Shows):
    """Hold models to choices and times: the sequential test, and a circuit beside it.

    DATA is a shipped set (see `bgmodel data`) or a table of your own: participant_id, rt (s),
    response, conditions. For each participant and model it says first what these trials can tell
    apart, then the parameters under which they are most likely. Simulated trials and finished fits
    are kept in the folder: the same command goes on where it was stopped.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary criterion=instruction;
    bgmodel fit mine.csv --strength contrast --criterion onset_stn --posterior
    """

    data: Positional[str]
    """Name of a shipped set, or a file, .csv, .tsv or .parquet."""
    folder: Positional[Path | None] = None
    """Where results go; fits/NAME, after the data, if left out."""
    models: tuple[str, ...] = ("constant_gap", "macaque")
    """Models: constant_gap, falling_gap, or a circuit, by its name or as a .toml file."""
    strength: str | None = None
    """Column of signed strengths: positive speaks for response 1."""
    participant: str | None = None
    """One participant; each for itself if left out."""
    pooled: bool = False
    """Take all participants for one."""
    upper: str | None = None
    """Name of the response that is 1, where responses are not 1 and 0."""
    deadline: float | None = None
    """When a trial without a response was over, s."""
    criterion: str = "threshold"
    """What sets a circuit's criterion: threshold, dopamine, stn_loss, gpe_loss, or within a trial
    rising_dopamine or onset_stn."""
    free: tuple[str, ...] = ()
    """Parameters to fit; if left out all but the threshold where the criterion is another."""
    hold: tuple[str, ...] = ()
    """Parameters to hold, as "lapse=0.02"."""
    vary: tuple[str, ...] = ()
    """Parameters that differ between levels of a column: "sensitivity=conflict",
    "criterion=instruction"; "stn_loss=stimulation/off" holds it at its start in level off."""
    posterior: bool = False
    """Draw from the posterior too: intervals of .9."""
    anyway: bool = False
    """Fit also what these data cannot tell apart."""
    engine: str = "population"
    """How the circuit is run: algebra, population, ensemble, ..."""
    noise_nats: float = 2.0
    """Noise of the evidence that reaches the circuit, its nats, after one second."""
    trials: int = 1500
    """Trials that the circuit is simulated with, at each of seven drifts."""
    seed: int = 24_001
    """Of the simulated trials."""

    def __call__(self) -> None:
        """Run the command."""
        _need()
        check_whole(trials=self.trials)
        columns = sorted({each.partition("/")[0] for each in self._vary.values()})
        choices = self._read(columns)
        folder = self.folder or Path("fits") / Path(self.data).stem
        files.check_writable(folder)
        self.note(choices.summary())
        people: list[tuple[str, Choices]] = [("all", choices)]
        if not self.pooled:
            people = [(who, choices.where(choices.participant == who)) for who in choices.people()]
        models = [self._model(name, choices, folder) for name in self.models]
        made: list[tuple[pd.DataFrame, pd.DataFrame]] = []
        for who, some in people:
            drawn = {}
            for name, model in zip(self.models, models, strict=True):
                found = self._one(who, some, columns, name, model, folder)
                made.append(found)
                drawn[name] = found[1]
            _draw(drawn, f"{choices.source}, {who}", folder / f"{who}.png")
        self._gather(made, folder)

    @property
    def _vary(self) -> dict[str, str]:
        return dict(_pair(each, "vary") for each in self.vary)

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

    def _model(self, name: str, choices: Choices, folder: Path) -> Model:
        import numpy as np

        from bgmodel.fitting.algorithms import GapModel
        from bgmodel.fitting.circuit import CRITERIA, CircuitModel

        if name in GAPS:
            return GapModel(GAPS[name])
        if self.criterion not in CRITERIA:
            allowed = ", ".join(CRITERIA)
            raise ValueError(f"criterion must be one of {allowed}, got {self.criterion!r}")
        longest = choices.deadline_s or float(np.nanmax(choices.rt_s))
        return CircuitModel(
            _circuit(name),
            self.engine,
            CRITERIA[self.criterion],
            noise_nats=self.noise_nats,
            # Whole half seconds, so that participants share what is simulated.
            seconds=float(np.ceil(2 * longest) / 2),
            trials=self.trials,
            seed=self.seed,
            folder=folder / "stored",
        )

    def _likelihood(self, some: Choices, columns: list[str], model: Model) -> Likelihood:
        from bgmodel.fitting.design import design_of
        from bgmodel.fitting.optimum import likelihood_of

        design = design_of(some, columns)
        known = {each.name for each in model.parameters}

        def own(name: str) -> str:
            return model.criterion_name if name == "criterion" else name

        # A parameter that another of the models has says nothing to this one.
        hold = {own(k): float(v) for k, v in (_pair(each, "hold") for each in self.hold)}
        vary = {own(k): v for k, v in self._vary.items()}
        return likelihood_of(
            model,
            design,
            free=[own(each) for each in self.free if own(each) in known] or None,
            fixed={k: v for k, v in hold.items() if k in known},
            vary={k: v for k, v in vary.items() if k in known},
        )

    def _one(
        self, who: str, some: Choices, columns: list[str], name: str, model: Model, folder: Path
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return the parameters and the cells of one fit, from its files or made now."""
        from tqdm import tqdm

        from bgmodel.fitting.fit import fit

        likelihood = self._likelihood(some, columns, model)
        key: dict[str, Any] = {
            "participant": who,
            "data": some.checksum,
            "model": recorded(model.identity()),
            "free": likelihood.freedom.names,
            "values": [each.start for each in likelihood.freedom.parameters],
            "posterior": self.posterior,
        }
        stem = folder / "pieces" / f"{who} {Path(name).stem}"
        there = _kept(stem, key)
        if there is not None:
            self.note(f"{who}, {name}: there already")
            return there
        shape = "{desc} {elapsed}{postfix}"
        with tqdm(desc=f"{who}, {name}", bar_format=shape, disable=None) as bar:
            said = bar.set_postfix_str
            found = fit(likelihood, draws=self.posterior, anyway=self.anyway, tell=said)
        self._say(who, name, found)
        parameters = found.parameters()
        parameters.insert(0, "participant", who)
        parameters.insert(1, "model", name)
        parameters["log_likelihood"] = found.optimum.log_likelihood
        cells = found.cells()
        cells.insert(0, "participant", who)
        cells.insert(1, "model", name)
        stem.parent.mkdir(parents=True, exist_ok=True)
        files.write_table(cells, _file(stem, "cells"), seed=self.seed, fit=key)
        files.write_table(parameters, _file(stem, "parameters"), seed=self.seed, fit=key)
        return parameters, cells

    def _say(self, who: str, name: str, found: Fit) -> None:
        """Say what can be told apart, and what lies at a bound."""
        import pandas as pd

        names = found.directions.names
        cosines = pd.DataFrame(found.directions.cosines, names, names).round(2)
        self.note(f"\n{who}, {name}: cosines of the directions in which parameters move the data")
        self.note(cosines.to_string())
        for each, at_bound in zip(names, found.optimum.at_bound, strict=True):
            if at_bound:
                say(f"{who}, {name}: {each} ends at a bound of its range: its error means nothing")

    def _gather(self, made: list[tuple[pd.DataFrame, pd.DataFrame]], folder: Path) -> None:
        import pandas as pd

        parameters = pd.concat([each for each, _ in made], ignore_index=True)
        cells = pd.concat([each for _, each in made], ignore_index=True)
        asked = {"data": self.data, "models": list(self.models), "vary": list(self.vary)}
        files.write_table(parameters, folder / "parameters.csv", seed=self.seed, **asked)
        files.write_table(cells, folder / "cells.csv", seed=self.seed, **asked)
        self.show("\n" + parameters.round(4).to_string(index=False), parameters)
        self.note(f"-> {folder}: parameters.csv, cells.csv, a figure for each participant")


def _need() -> None:
    try:
        import cma  # noqa: F401
        import emcee  # noqa: F401
    except ImportError as error:
        raise ImportError('fits need cma and emcee: pip install ".[fit]"') from error


def _circuit(name: str) -> Any:
    from circuits.anatomy import circuit

    return circuit(CircuitName.parse(name), 2)


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not value:
        example = f"{option} is a name, =, and a value, as criterion=instruction"
        raise ValueError(f"{example}, got {text!r}")
    return name.strip(), value.strip()


def _file(stem: Path, what: str) -> Path:
    return stem.with_name(f"{stem.name} {what}.parquet")


def _kept(stem: Path, key: dict[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Return the tables of a finished fit, or None where there is none of this key."""
    paths = [_file(stem, what) for what in ("parameters", "cells")]
    if not all(path.exists() for path in paths):
        return None
    plain = files.provenance(fit=key)["parameters"]["fit"]
    if files.read_provenance(paths[0])["parameters"]["fit"] != plain:
        return None
    parameters, cells = (files.read_table(path) for path in paths)
    return parameters, cells


def _draw(cells: dict[str, pd.DataFrame], title: str, path: Path) -> None:
    import matplotlib.pyplot as plt

    from bgmodel.fitting.drawing import draw_fits

    figure = draw_fits(cells, title)
    with files.replacing(path) as partial:
        figure.savefig(partial, metadata={"Software": None}, dpi=150)
    plt.close(figure)
