"""A model fitted to trials with known evidence: parameters, scores, hazards and kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

from bgmodel.fitting.known.hazards import hazards
from bgmodel.fitting.known.kernels import ALIGNED, DATA, POSITIONS, kernel
from bgmodel.fitting.known.likelihood import KnownLikelihood
from bgmodel.fitting.known.optimum import KnownOptimum, Score, known_optimum, score_of
from bgmodel.support.reprs import Facts
from bgmodel.support.tables import Readable
from circuits.errors import FitWarning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERROR_SHARE = 0.5
"""A parameter whose standard error exceeds this share of its value is hardly identified."""
SCALES = ("gain", "threshold", "noise")
"""Parameters for which that is worth a warning: the others may well be 0."""


@dataclass(frozen=True, repr=False)
class KnownFit(Facts):
    """A model fitted to trials with known evidence.

    Parameters
    ----------
    optimum : KnownOptimum
        The maximum of the likelihood.
    """

    optimum: KnownOptimum

    @property
    def likelihood(self) -> KnownLikelihood:
        """The likelihood, with model and data."""
        return self.optimum.likelihood

    @cached_property
    def score(self) -> Score:
        """Log likelihood, corrected for simulated runs, and BIC."""
        return score_of(self.optimum)

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name, free and fixed."""
        return self.likelihood.values(self.optimum.vector)

    def facts(self) -> dict[str, str]:
        """Return data, log likelihood and each parameter with its standard error."""
        trials, score = self.likelihood.trials, self.score
        said = f" +- {score.error:.1f}" if score.error else ""
        found = {
            "model": self.likelihood.model.name,
            "data": trials.source,
            "trials": f"{trials.trials}",
            "readings before the response": f"{trials.seen.sum()}",
            "log likelihood": f"{score.log_likelihood:.1f}{said} nats",
        }
        for row in self.parameters().itertuples():
            found[str(row.parameter)] = f"{row.value:.4g} +- {row.standard_error:.2g}"
        return found

    def parameters(self) -> pd.DataFrame:
        """Return one row per free parameter: parameter, value, standard_error, at_bound."""
        return pd.DataFrame(
            {
                "parameter": self.likelihood.freedom.names,
                "value": self.optimum.vector,
                "standard_error": self.optimum.standard_errors,
                "at_bound": self.optimum.at_bound,
            }
        )

    def summary(self) -> pd.DataFrame:
        """Return the parameters as a table to read."""
        table = self.parameters().set_index("parameter")
        numbers = ["value", "standard_error"]
        return Readable(table.assign(**{n: [float(f"{x:.4g}") for x in table[n]] for n in numbers}))

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``parameters()``."""
        return self.parameters()

    def hazards(self) -> pd.DataFrame:
        """Return the share of trials that end after each reading, data and model.

        One row per reading; see ``hazards.hazards``.
        """
        return hazards(self.likelihood, self.optimum.vector)

    def kernels(self, *, positions: int = POSITIONS) -> pd.DataFrame:
        """Return psychophysical kernels of the data and of the model.

        The model's is of its choices given the response times of the data. Columns as for
        ``kernels.kernel``; ``of``, "data" or the name of the model; and ``align``, "onset" or
        "response".
        """
        trials = self.likelihood.trials
        own = self.likelihood.chosen(self.optimum.vector)
        tables = [
            kernel(trials, chosen, positions=positions, align=align).assign(of=name, align=align)
            for align in ALIGNED
            for name, chosen in ((DATA, None), (self.likelihood.model.name, own))
        ]
        return pd.concat(tables, ignore_index=True)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as plain values, for JSON: model, data, scores and parameters."""
        rows = self.parameters().to_dict("records")
        return {
            "model": self.likelihood.model.identity(),
            "trials": self.likelihood.trials.trials,
            "readings": int(self.likelihood.trials.seen.sum()),
            "log_likelihood": self.score.log_likelihood,
            "simulation_error": self.score.error,
            "bic": self.score.bic,
            "fixed": dict(self.likelihood.freedom.held.items()),
            "parameters": rows,
        }

    def plot(self) -> Figure:
        """Draw hazards per reading and kernels, data and model."""
        from bgmodel.fitting.known.drawing import draw_known

        name = self.likelihood.model.name
        hazards, kernels = {name: self.hazards()}, {name: self.kernels()}
        return draw_known(hazards, kernels, self.likelihood.trials.title)

    def cautions(self) -> list[str]:
        """Return a sentence for each doubt: parameters at a bound or hardly identified."""
        found = []
        best = self.optimum
        names = self.likelihood.freedom.names
        columns = (best.vector, best.standard_errors, best.at_bound)
        for name, value, error, at_bound in zip(names, *columns, strict=True):
            if at_bound and name in SCALES:
                found.append(
                    f"{self.likelihood.model.name}: {name} is at a bound of its range, {value:.3g}"
                )
            elif name in SCALES and not error < ERROR_SHARE * abs(value):
                found.append(
                    f"{self.likelihood.model.name}: these trials hardly identify {name} "
                    f"({value:.3g} +- {error:.2g}): fix it, or add trials with other evidence"
                )
        return found


def fit_known(
    likelihood: KnownLikelihood, *, tell: Callable[[str], None] = lambda _: None
) -> KnownFit:
    """Fit a model to trials with known evidence.

    Parameters
    ----------
    likelihood : KnownLikelihood
        Model, data and free parameters.
    tell : function
        Called with a text on the progress.

    Warns
    -----
    UserWarning
        If gain, threshold or noise end at a bound or are hardly identified, and if the data show
        that the evidence has no effect.
    """
    tell(f"fitting {likelihood.model.name}")
    fit = KnownFit(known_optimum(likelihood))
    for caution in fit.cautions():
        FitWarning.warn(caution)
    return fit
