"""All shipped circuits, and four broken controls, under one exam of published numbers.

The list, its tasks and the domain in which each control must rank last were written before these
runs, the domain after a trial on another seed. Each examinee sits three times.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.exam.exam import Exam
from bgmodel.exam.numbers import SEED
from bgmodel.exam.record import MOST_Z, totals
from bgmodel.experiments.expected import AGREES, UNANSWERED
from bgmodel.experiments.models import DecisionModel, model_of
from circuits.anatomy import CIRCUITS, DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.laws.controls import shuffled_stn
from figures.pieces import Made, Piece, Score

SEEDS = (SEED, SEED + 1, SEED + 2)
COARSE = 0.2
"""Share of trials in the coarse form."""
SECONDS = 40
ROUNDING = 1e-9
FAINT = 1e-9
"""Factor of cortical pathways in noise alone; a circuit without a path is refused."""


def _held(name: str) -> Callable[[Circuit], Circuit]:
    return lambda table: table.clamp(name)


def noise_alone(table: Circuit) -> Circuit:
    """Return the circuit whose nuclei hear nothing of the evidence, and rest as before."""
    deaf = table
    for target in {row.target: None for row in table.projections if row.source == table.input}:
        deaf = deaf.scale(f"{table.input}->{target}", FAINT)
    return deaf.compensate(table)


CONTROLS: dict[str, tuple[str, Callable[[Circuit], Circuit]]] = {
    "no GPe": ("optimality", _held("GPe")),
    "shuffled STN->SNr": ("optimality", shuffled_stn),
    "no D1": ("optimality", _held("D1")),
    "noise alone": ("optimality", noise_alone),
}
"""Broken circuits, edits of the default one, and the domain in which each must rank last. Held
nuclei fire at their resting rates."""


NO_MOTIFS = ("macaque", "macaque_small")
"""Circuits that also sit without the motifs of tasks, with a constant criterion."""
WITHOUT = ", no motifs"
"""What their names then end with."""
OTHERS_RATES = Path(__file__).parent / "others"
"""Rates of circuits of other people, a table each; SOURCES.md says whose."""
GAMES = {
    "SNr barely changes its rate": ("set SNr.gain_hz_per_nat 6", "set SNr.baseline_hz 63.7"),
    "D2 barely changes its rate": ("set D2.gain_hz_per_nat 0.05",),
    "D1 barely changes its rate": ("set D1.gain_hz_per_nat 0.3",),
    "OUT falls in every task": ("add SNr amount=-0.5 rise_ms=1000",),
    "cortex bursts in every task": ("add ctx amount=1.2 to_ms=120 rise_ms=20 decay_ms=120",),
}
"""Edits of the default circuit that might raise its score without a meaning."""
MECHANISMS = {
    "cortex codes likelihoods": (
        "set ctx.transfer exp", "set ctx.gain_hz_per_nat 4.4", "set ctx.baseline_hz 0",
        *(f"set ctx->{name}.transfer log" for name in ("D1", "D2", "STN", "FSI", "ctx_inh")),
    ),
    "SNr commits": (
        "add commitment cell=Rate transmitter=GABA transfer=saturating bias_nats=1.6"
        " gain_hz_per_nat=10 tau_ms=5",
        "add SNr->commitment weight=-20 tau_ms=4 delay_ms=2",
        "add commitment->SNr weight=-3 tau_ms=4 delay_ms=2 pattern=diffuse",
    ),
    "faster legs": (
        "set STN->SNr.tau_ms 4", "set STN.tau_ms 5", "set GPe->STN.tau_ms 4",
        "set GPe->STN.delay_ms 4", "set D1->SNr.delay_ms 5", "set ctx->D1.delay_ms 3",
    ),
    "dopamine at cortical synapses": (
        'set D1.receptor ""', 'set D2.receptor ""', "set ctx->D1.receptor D1",
        "set ctx->D2.receptor D2",
    ),
    "dopamine at terminals": (
        'set D1.receptor ""', 'set D2.receptor ""', "set D1->SNr.receptor D1",
        "set D2->GPe.receptor D2",
    ),
}  # fmt: skip
"""Mechanisms that the family of OUT = -ln P leaves open, as edits of the default circuit.

Where cortex fires by the exponential of its input and synapses take the logarithm, only what all
channels share changes. A nucleus that a silent SNr sets free silences it further. Dopamine acts on
D1 and D2 themselves in the default circuit.
"""
FEW = 8
"""Largest number of answers that are listed by name; more are counted."""


def examinees() -> dict[str, DecisionModel]:
    """Return every examinee by name."""
    by_name = {name: model_of(name) for name in CIRCUITS}
    for name, (_, edit) in CONTROLS.items():
        by_name[name] = DecisionModel(name, partial(_edited, edit))
    return by_name | {f"{name}{WITHOUT}": by_name[name] for name in NO_MOTIFS}


def _edited(edit: Callable[[Circuit], Circuit], channels: int) -> Circuit:
    return edit(load_circuit(DEFAULT, channels))


def sat(name: str, seed: int, share: float, workers: int) -> pd.DataFrame:
    """Return the rows of an exam, and the CPU time that it took."""
    begun = time.process_time()
    record = Exam.shipped().take(
        examinees()[name],
        seed=seed,
        share=share,
        motifs=not name.endswith(WITHOUT),
        workers=workers,
    )
    taken = time.process_time() - begun
    engine = record.parameters.get("engine", "")
    return record.table.assign(examinee=name, sitting=seed, engine=engine, cpu_s=taken)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per examinee and seed."""
    for seed in SEEDS[: 1 if fast else None]:
        for name in examinees():
            share = COARSE if fast else 1.0
            make = partial(sat, name, seed, share, workers)
            file = name.replace("->", " to ")
            yield Piece("exam", f"{file}, seed {seed}", round(1000 * share), SECONDS, make)
    for kind, edits in (("games", GAMES), ("mechanisms", MECHANISMS)):
        for name in edits:
            make = partial(edited, edits[name], name, SEED, share, workers)
            yield Piece(kind, name, round(1000 * share), SECONDS, make)
    yield Piece("others", "rates", 1, 1, others)


def edited(
    edits: tuple[str, ...], name: str, seed: int, share: float, workers: int
) -> pd.DataFrame:
    """Return the rows of an exam of the default circuit with edits, under their name."""
    record = Exam.shipped().take(DEFAULT, edits=edits, seed=seed, share=share, workers=workers)
    return record.table.assign(edit=name)


def others() -> pd.DataFrame:
    """Return the rows of an exam of each circuit in ``others``."""
    parts = []
    for path in sorted(OTHERS_RATES.glob("*.csv")):
        record = Exam.shipped().mark(rates=path, name=path.stem)
        parts.append(record.table.assign(circuit=path.stem))
    return pd.concat(parts, ignore_index=True)


def games(tried: pd.DataFrame, plain: pd.DataFrame) -> pd.DataFrame:
    """Return what edits win and lose against the circuit without them."""
    before = plain.set_index("id")["outcome"] == AGREES
    rows = []
    for name, part in tried.groupby("edit", sort=False):
        after = part.set_index("id")["outcome"] == AGREES
        won, lost = (_listed(before.index[k]) for k in (after & ~before, before & ~after))
        rows.append((name, int(after.sum() - before.sum()), won, lost))
    return pd.DataFrame(rows, columns=["edit", "more", "won", "lost"])


def _listed(ids: pd.Index) -> str:
    return ", ".join(ids) if len(ids) <= FEW else f"{len(ids)} numbers"


def judged(table: pd.DataFrame) -> pd.Series:
    """Return whether each number differs, over all seeds, in the same way, or agrees in all."""
    values = table.groupby(["examinee", "id"], sort=False)

    def same(part: pd.DataFrame) -> str:
        far = part["z"].abs() > MOST_Z
        if far.any():
            signs = np.sign(part["z"].dropna())
            return "same sign" if signs.nunique() == 1 else "other sign"
        return "same outcome" if part["outcome"].nunique() == 1 else "other outcome"

    return values.apply(same)


def ranks(domains: pd.DataFrame) -> pd.DataFrame:
    """Return the rank of each control in its domain, by the mean share over seeds."""
    mean = domains.groupby(["domain", "examinee"], sort=False)["share"].mean()
    rows = []
    for name, (domain, _) in CONTROLS.items():
        here = mean[domain].drop([other for other in CONTROLS if other != name]).dropna()
        row = {"control": name, "domain": domain, "share": here[name]}
        others = here.drop(name)
        row |= {
            "worse": int((others < here[name]).sum()),
            "tied": int((others == here[name]).sum()),
        }
        shares = mean.unstack("examinee")
        kept = shares.index[shares[name] >= shares[DEFAULT] - ROUNDING].tolist()
        rows.append(row | {"of": len(here), "as_good_as_default": "; ".join(kept)})
    return pd.DataFrame(rows)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the list, all answers, domains, stability, controls, cost, edits, others' rates."""
    answers = made["exam"]
    plain = answers[(answers["examinee"] == DEFAULT) & (answers["sitting"] == SEED)]
    asked = made["others"][made["others"]["outcome"] != UNANSWERED]
    about = [
        (one.id, one.domain, one.about, one.published(), one.unit, one.species, one.mark,
         one.source, one.weight, one.how)
        for one in Exam.shipped().numbers
    ]  # fmt: skip
    names = ["id", "domain", "about", "published", "unit", "species", "mark", "source", "weight"]
    kept = ["examinee", "sitting", "id", "domain", "value", "se", "z", "outcome", "set_by"]
    parts = []
    for (name, seed), part in answers.groupby(["examinee", "sitting"], sort=False):
        parts.append(totals(part).assign(examinee=name, sitting=seed))
    domains = pd.concat(parts, ignore_index=True)
    stable = judged(answers).rename("stability").reset_index()
    cost = answers.groupby(["examinee", "sitting"], sort=False)[["engine", "cpu_s"]].first()
    return {
        "list": ("exam", pd.DataFrame(about, columns=[*names, "how"])),
        "numbers": ("exam", answers[kept]),
        "domains": ("exam", domains),
        "stability": ("exam", stable),
        "controls": ("exam", ranks(domains)),
        "cost": ("exam", cost.reset_index()),
        "games": ("games", games(made["games"], plain)),
        "mechanisms": ("mechanisms", games(made["mechanisms"], plain)),
        "others": ("others", asked[["circuit", "id", "published", "value", "se", "z", "outcome"]]),
    }


OTHERS = tuple(name for name in CIRCUITS if name != DEFAULT)
SCORE = Score("exam", SEED, (2, 4, 8), pieces, tables, circuit=DEFAULT, others=OTHERS)
