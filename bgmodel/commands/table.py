"""All commands by name."""

from __future__ import annotations

from typing import Any

from bgmodel.commands.bench import BenchRun
from bgmodel.commands.circuit import CircuitExport, CircuitRun, CircuitShow
from bgmodel.commands.comparing import CircuitCompareEdits, Compare
from bgmodel.commands.data import Data
from bgmodel.commands.decisions import Decide
from bgmodel.commands.demo import DemoRun
from bgmodel.commands.designed import CircuitDesigned
from bgmodel.commands.discriminate import DiscriminateRun
from bgmodel.commands.experiments import ExperimentRun
from bgmodel.commands.explore import Explore
from bgmodel.commands.figures import Figures
from bgmodel.commands.fits import FitRun
from bgmodel.commands.learn import LearnRun
from bgmodel.commands.stopping import StopRun
from bgmodel.commands.sweeps import SweepRun
from bgmodel.commands.taps import Decode, Simulate, Train
from bgmodel.commands.touch import Touch
from bgmodel.commands.watch import Watch

CIRCUIT = {
    "show": CircuitShow,
    "run": CircuitRun,
    "export": CircuitExport,
    "compare-edits": CircuitCompareEdits,
    "designed": CircuitDesigned,
}
# A name and its command, or a name and a group: a description of it, and a table like this one
# with two commands or more.
COMMANDS: dict[str, Any] = {
    "demo": DemoRun,
    "touch": Touch,
    "watch": Watch,
    "simulate": Simulate,
    "train": Train,
    "decode": Decode,
    "decide": Decide,
    "learn": LearnRun,
    "circuit": (
        "A basal ganglia circuit: show its table, run it, lesion it, export it to Brian2, compare "
        "it with theories. Example: bgmodel circuit show",
        CIRCUIT,
    ),
    "stop": StopRun,
    "compare": Compare,
    "data": Data,
    "fit": FitRun,
    "experiment": ExperimentRun,
    "explore": Explore,
    "sweep": SweepRun,
    "bench": BenchRun,
    "discriminate": DiscriminateRun,
    "figures": Figures,
}
