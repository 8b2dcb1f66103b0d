"""Old names of ``bgmodel``: a line an old name, as in ``circuits/moved.py``."""

from __future__ import annotations

from contextlib import suppress

MOVED = {
    "bgmodel.basal_ganglia": "bgmodel.integrators.basal_ganglia",
    "bgmodel.behaviour": "bgmodel.experiments.measures",
    "bgmodel.circuit_edits": "circuits.controls (out_shift and the like: "
    "bgmodel.comparison.steady)",
    "bgmodel.circuit_page": "bgmodel.comparison.page",
    "bgmodel.circuit_study": "bgmodel.comparison.circuits",
    "bgmodel.dopamine_study": "bgmodel.learning.level",
    "bgmodel.empirical": "bgmodel.theory.empirical",
    "bgmodel.evidence_tables": "bgmodel.tables.evidence",
    "bgmodel.experiment": "bgmodel.experiments.experiment",
    "bgmodel.exports": "bgmodel.tables.exports",
    "bgmodel.experiments.toml_files": "bgmodel.toml_files",
    "bgmodel.first_passage": "bgmodel.theory.first_passage",
    "bgmodel.outcomes": "bgmodel.experiments.outcomes",
    "bgmodel.policies": "bgmodel.learning.policies",
    "bgmodel.rivals": "bgmodel.integrators.rivals",
    "bgmodel.sprt": "bgmodel.integrators.sprt",
    "bgmodel.study": "bgmodel.learning.gap",
}
"""Old dotted name: the new one."""


def _members(old: str, new: str, names: str) -> dict[str, str]:
    """Return the lines of a module that is a folder now: its names moved one level down."""
    return {f"{old}.{name}": f"{new}.{name}" for name in names.split()}


MOVED |= {
    "bgmodel.comparison.Sweep": "bgmodel.comparison.compare.Tradeoff",
    "bgmodel.comparison.sweep": "bgmodel.comparison.compare.tradeoff",
}
MOVED |= _members(
    "bgmodel.comparison",
    "bgmodel.comparison.compare",
    "curve time_at latency resampled interval shown check_trials equivalent reads_nothing",
)
MOVED |= _members(
    "bgmodel.learning",
    "bgmodel.learning.reinforce",
    "exhaustive_search Learner Learned LearningStopped Environment learn smoothed",
)
MOVED |= _members("bgmodel.learning", "bgmodel.learning.reward", "mean_reward check_xi")
MOVED |= {
    "bgmodel.learning.trials_of": "bgmodel.learning.worlds.trials_of",
    "bgmodel.integrators.sprt.totals": "bgmodel.evidence.Evidence.totals",
    "bgmodel.integrators.basal_ganglia.decoded_input": "bgmodel.comparison.decoder.decoded_input",
    "bgmodel.dopamine.Body": "bgmodel.learning.worlds.LevelOutcomes",
    "bgmodel.dopamine.knob": "bgmodel.dopamine.decide_at_levels",
    "bgmodel.dopamine.switching": "bgmodel.learning.worlds.switching",
}
MOVED |= _members("bgmodel.tables", "bgmodel.tables.trials", "Trials trial_table")
MOVED |= _members(
    "bgmodel.theory",
    "bgmodel.theory.sprt",
    "Performance Optimum wald siegmund optimal_threshold reward_curve optimal_delta",
)


def missing(name: str) -> ImportError | AttributeError:
    """Return the error of a name that ``bgmodel`` has not, with the new name of an old one."""
    old = f"bgmodel.{name}"
    if old in MOVED:
        return ImportError(f"{old} is now {MOVED[old]}", name=old)
    return AttributeError(f"module 'bgmodel' has no attribute {name!r}")


def tell_old_names() -> None:
    """Let imports of old names raise a sentence with the new one."""
    # Where another distribution's `circuits` is found, the circuit's integrator says so.
    with suppress(ImportError):
        from circuits.moved import tell

        tell(MOVED)
