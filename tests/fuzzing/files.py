"""Files of experiments."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from bgmodel.experiments.experiment import Experiment
from tests.fuzzing.case import Case, Rng, pick

VALID_TOML = {
    "name": ['"a lesion"', '"x"'],
    "published": ['"faster"', '""'],
    "source": ['"nobody"'],
    "note": ['"a test"', '"""\ntwo\nlines"""'],
    "engine": ['"algebra"'],
    "seed": ["0", "3", "123456"],
    "posterior": ["0.8", "0.7"],
    "foreperiod_ms": ["100.0", "50"],
    "gain": ["0.5", "1"],
}
BROKEN_TOML = [
    ("seed", '"three"'),
    ("seed", "1.5"),
    ("seed", "true"),
    ("posterior", "1.0"),
    ("posterior", "95"),
    ("posterior", '"0.9"'),
    ("foreperiod_ms", "0"),
    ("foreperiod_ms", "inf"),
    ("engine", '"spikes"'),
    ("gains", "1"),
    ("name", "3"),
    ("published", "2026-01-01"),
    ("truth", "7"),
    ("task.trials", "0"),
    ("task.trials", "1e13"),
    ("task.conflict", "1.0"),
    ("task.channels", "1"),
    ("task.period_mm", "2.5"),
    ("task.size", "3"),
    ("manipulation.without", '"STN"'),
    ("manipulation.with_out", '["STN"]'),
    ("manipulation.posterior", "2"),
    ("control.neurons", '"3"'),
    ("predictions.measure", '"speed"'),
    ("predictions.direction", '"left"'),
    ("predictions.at_least", "-1"),
    ("predictions.at_least", "nan"),
]


def toml(rng: Rng, valid: bool) -> str:
    """Return the text of an experiment's file, broken in one place unless valid."""
    top = {name: pick(rng, *values) for name, values in VALID_TOML.items()}
    parts = {
        "task": {"trials": str(rng.integers(100, 300)), "t_max": str(rng.integers(6, 9))}
        | {"d_prime": "2.0"},
        "control": {},
        "manipulation": {"without": f'["STN={rng.uniform(0.005, 0.05):.3f}"]'},
        "predictions": {
            "measure": pick(rng, '"accuracy"', '"mean_ms"', '"missed"'),
            "direction": pick(rng, '"up"', '"down"', '"none"'),
            "at_least": f"{rng.uniform(0.01, 0.4):.3f}",
        },
    }
    if parts["predictions"]["measure"] == '"mean_ms"':
        parts["predictions"]["at_least"] = f"{rng.uniform(1, 30):.3f}"
    if rng.random() < 0.5:
        top["truth"] = "1"
        parts["task"]["trials"] = "240"
    if not valid:
        place, value = BROKEN_TOML[int(rng.integers(len(BROKEN_TOML)))]
        part, dot, key = place.partition(".")
        (parts[part] if dot else top)[key if dot else place] = value
    lines = [f"{key} = {value}" for key, value in top.items()]
    for name, keys in parts.items():
        if keys:
            lines.append(f"[[{name}]]" if name == "predictions" else f"[{name}]")
            lines += [f"{key} = {value}" for key, value in keys.items()]
    if not valid and rng.random() < 0.2:
        # Or one line is no TOML, or a key that must be there is not.
        gone = [k for k, line in enumerate(lines) if line.startswith(("name", "source", "measure"))]
        lines[pick(rng, *gone)] = pick(rng, "", "= 3", "name = 'open", "[task")
    return "\n".join(lines) + "\n"


def toml_file(rng: Rng, folder: Path) -> Case:
    """Return an experiment's file, to be read."""
    valid = bool(rng.random() < 0.5)
    text = toml(rng, valid)
    path = folder / "mine.toml"
    path.write_text(text)

    def check(found: Any) -> None:
        plain = tomllib.loads(text)
        assert found.name == plain["name"]
        assert found.task.trials == plain["task"]["trials"]
        assert found.predictions[0].at_least == plain["predictions"][0]["at_least"]
        assert found.manipulation.without == tuple(plain["manipulation"]["without"])
        assert found.seed == plain["seed"]

    return Case(valid, call=lambda: Experiment.from_toml(path), check=check)
