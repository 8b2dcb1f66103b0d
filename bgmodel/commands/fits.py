"""The command that fits models to choice and response-time data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from bgmodel.commands.options import MANY, Workers, like, record_of, values
from bgmodel.commands.output import UNRECORDED, Output, check_whole, say, stages
from bgmodel.fits import SIMULATED, fit_all, question
from bgmodel.fitting.settings import FitSettings, need_fit
from bgmodel.fitting.several import Fits, GroupFits, stem
from bgmodel.support import files
from bgmodel.trials.reading import OURS
from bgmodel.version import __version__
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

OF_EVIDENCE = ("step_ms", "forced", "runs")
"""Settings of known evidence, given by --evidence."""
OF_SIMULATION = ("trials", "seed", "engine", "noise_nats")
"""Settings of simulated trials, given by --simulation."""
EACH = ("parameters", "cells")
GROUP = ("group", "people", "people_cells", "group_effects", "group_correlations")
"""Tables of fits to each participant, and of hierarchical fits."""
EACH_DRAWN = "a figure for each participant"
GROUP_DRAWN = (
    "figures of each model's parameters, and of data and model; the draws (.nc, for ArviZ)"
)
ESTIMATES = "estimates.csv"
"""Table of estimates without a model, such as SSRT by integration, for trials that have any."""
UNSHARED = ("evidence", "participant", "draws", "compare", *UNRECORDED)
"""Settings that fits in one folder need not share, or that are recorded in another way."""


@like(FitSettings, "strength", "participant", "people", "vary", "formula", "free", "fix", "prior",
      "mechanism", "draws", "compare")  # fmt: skip
def fit(
    data: str = "",
    folder: Path | None = None,
    /,
    *,
    models: Annotated[tuple[str, ...], MANY] = (),
    columns: Annotated[tuple[str, ...], MANY] = (),
    simulation: Annotated[tuple[str, ...], MANY] = (),
    evidence: Annotated[tuple[str, ...], MANY] = (),
    workers: Workers = 2,
    json: bool = False,
    force: bool = False,
    **options: Any,
) -> None:
    """Fit the sequential test and a circuit to choice and response-time data.

    DATA is a shipped set or your own table: participant_id, rt (s), response, conditions. Without
    DATA it lists the shipped sets, with their sources. For each participant and model it prints
    which parameters these trials can identify, and at the end the maximum-likelihood parameters.
    Simulated trials and finished fits are kept in FOLDER (by default fits/ and the name of the
    data): the same command resumes where it stopped.

    The columns of DATA say what kind of trials they are: with rewards they are fitted by learners,
    with stop-signal delays by stop processes, and with --evidence by models that answer for each
    trial.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary threshold=instruction;
    bgmodel fit mine.csv --formula "bound ~ instruction * side" --columns rt=RT_ms rt_unit=ms;
    bgmodel fit cavanagh_2011 --people hierarchical --models constant_gap;
    bgmodel fit trials.csv --evidence evidence.csv --models msprt leaky_sum run macaque

    Parameters
    ----------
    data
        Name of a shipped set, or a .csv, .tsv or .parquet file.
    folder
        Folder for results.
    models
        Models: constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives), msprt,
        race, lca (two or more), or a circuit, by its name or as a .toml file. By default
        constant_gap and macaque, or msprt and macaque with more than two alternatives. Of rewarded
        choices: "no learning", q, "q, two rates", "logit q", confidence, "confidence, two rates",
        opal. Of stop-signal trials: constant_gap or a circuit. With --evidence: msprt, leaky_sum,
        run or a circuit.
    columns
        How the table is read, name=value: rt, response, participant, ssd and trial_type (columns
        of other names), rt_unit (s or ms), upper (the response that counts as 1), alternatives
        (their number), stimulus (column of the correct alternative), deadline_s (time at which a
        trial without a response ended), withheld (the response of a go/no-go task that is given by
        waiting until then), rt_window (earliest and latest response time to fit, s, as
        0,inf for all), restore_delays (of stop signals, those recorded as 0).
    simulation
        Simulated trials of a circuit, name=value: trials at each of seven drifts, seed, engine,
        noise_nats (noise of the evidence: its standard deviation after one second, nats).
    evidence
        File with the readings of each trial, for models that answer for each trial:
        columns trial, step and `ll_<alternative>`; trial, time (s) and `ll_<alternative>`; or one
        row per cue with trial, time and side or value (nats). Then name=value: step_ms (time
        between readings, if the table has steps), forced=true (the last reading forces a response),
        runs (simulated runs of each trial by a circuit; by default 8 to 32).
    json
        Print one JSON object, the rows of the result under "records", and nothing else on stdout.
    force
        Overwrite existing results.
    """
    output = Output(json=json, force=force)
    if not data:
        _list(output)
        return
    need_fit()
    check_whole(workers=workers)
    window = [word for word in columns if word.partition("=")[0] == "rt_window"]
    rest = [word for word in columns if word not in window]
    more: dict[str, Any] = {"columns": record_of(OURS, rest)}
    for words, known in ((window, ("rt_window",)), (simulation, OF_SIMULATION),
                         (evidence[1:], OF_EVIDENCE)):  # fmt: skip
        more |= values(words, FitSettings, known)
    asked = FitSettings(evidence=Path(evidence[0]) if evidence else None, **more, **options)
    asked.check()
    folder = folder or Path("fits") / Path(data).stem
    try:
        one = question(asked, data, models, folder / SIMULATED)
        for lacking in one.lacking:
            say(lacking)
        behind, path = _behind(asked, data), folder / ESTIMATES
        made, estimates = {**behind, "circuits": one.circuits()}, one.estimates()
        if estimates is not None:
            files.check_new(path, force=files.is_result(path))
        _check(folder, GROUP if asked.hierarchical else EACH, made, force)
        if estimates is not None:
            files.write_table(estimates, path, seed=asked.seed, **behind)
        output.note(one.trials.summary())
        fits = fit_all(one, folder, workers=workers, note=output.note, stages=stages)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "Finished fits and simulated trials are kept: the same command resumes there."
        ) from None
    _write(fits, folder, asked.seed, made, output)


def _write(
    fits: Fits | GroupFits, folder: Path, seed: int, made: dict[str, Any], output: Output
) -> None:
    """Write tables, figures and draws, and print the parameters."""
    tables = fits.tables()
    every = {name: _with_others(folder / f"{name}.csv", tables[name], made) for name in tables}
    for name, (table, behind) in every.items():
        files.write_table(table, folder / f"{name}.csv", seed=seed, **behind)
    figures = fits.figures()
    if fits.comparison is not None:
        path = folder / "comparison.csv"
        files.write_table(fits.comparison.to_dataframe(), path, seed=seed, **made)
        figures["comparison"] = fits.comparison.plot
        output.note("\n" + fits.comparison.summary())
    for name, draw in figures.items():
        try:
            files.save_figure(draw(), folder / f"{name}.png")
        except InputError as error:
            output.note(f"{name}: no figure, {error}")
    shown = next(iter(every.values()))[0]
    text, facts, more = "\n" + shown.round(4).to_string(index=False), {}, EACH_DRAWN
    if isinstance(fits, GroupFits):
        for name, fit in fits.fits.items():
            fit.to_netcdf(folder / f"{stem(name)}.nc")
        related = {"effects": fits.effects(), "correlations": fits.correlations()}
        facts = {name: table.to_dict("records") for name, table in related.items()}
        text, more = "\n\n".join(filter(None, [text, fits.notes()])), GROUP_DRAWN
    output.show(text, shown, **facts)
    output.note(f"-> {folder}: {', '.join(f'{name}.csv' for name in tables)}; {more}")


def _behind(asked: FitSettings, data: str) -> dict[str, Any]:
    """Return the settings that all fits in one folder must share; participants may differ."""
    shared = {each.name for each in fields(asked)} - {*UNSHARED}
    options = {name: files.recorded(getattr(asked, name)) for name in sorted(shared)}
    if asked.rt_window is not None:
        # As text, since JSON has no infinity.
        options["rt_window"] = [f"{time:g}" for time in asked.rt_window]
    simulated = {"simulated_trials": options.pop("trials"), "simulation_seed": asked.seed}
    # Of the whole table: participants may be fitted one after the other.
    trials = files.checksum(data) if Path(data).is_file() else data
    known = {"evidence": files.checksum(str(asked.evidence))} if asked.evidence else {}
    version = {"bgmodel": __version__}
    return {"data": data, "trials": trials, **known, **simulated, **options, **version}


def _check(folder: Path, names: Sequence[str], made: Mapping[str, Any], force: bool) -> None:
    """Raise ValueError if a folder can't be written, or holds other tables, unless by force."""
    files.check_writable(folder)
    other = set()
    for path in (folder / f"{name}.csv" for name in names):
        if path.exists() and not files.is_result(path):
            reason = f"{str(path)!r} exists and is not a result of a fit: give another folder"
            raise InputError(reason, "folder")
        other |= _differing(path, made)
    if other and not force:
        raise InputError(
            f"{str(folder)!r} holds fits with another {', '.join(sorted(other))}: give another "
            "folder, or --force to overwrite their tables",
            "folder",
        )


def _before(path: Path) -> dict[str, Any]:
    """Return the parameters of an existing table; an empty dict without a table."""
    return files.read_provenance(path)["parameters"] if files.is_result(path) else {}


def _differing(path: Path, made: Mapping[str, Any]) -> set[str]:
    """Return the names of settings with other values in an existing table."""
    if not (before := _before(path)):
        return set()
    now, circuits = files.provenance(**made)["parameters"], before.pop("circuits", {})
    changed = any(circuits.get(name, sha) != sha for name, sha in now.pop("circuits").items())
    names = {name for name in {*before, *now} if before.get(name) != now.get(name)}
    return names | ({"circuit"} if changed else set())


def _with_others(
    path: Path, table: pd.DataFrame, made: dict[str, Any]
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return a table with the fits of others to the same question in its file, and its origin."""
    import pandas as pd

    before = _before(path)
    if not before or _differing(path, made):
        return table, made
    # Columns that are text in the new table stay text.
    texts = [name for name in table if pd.api.types.is_string_dtype(table[name])]
    none = {str(name): [""] for name in table if name not in texts}
    there = pd.read_csv(path, dtype=dict.fromkeys(texts, str), keep_default_na=False,
                        na_values=none)  # fmt: skip
    # A group is fitted as a whole.
    who = ["participant", "model"] if path.stem in EACH else ["model"]
    ours = pd.MultiIndex.from_frame(table[who].astype(str))
    others = ~pd.MultiIndex.from_frame(there[who].astype(str)).isin(ours)
    circuits = {**before["circuits"], **made["circuits"]}
    return pd.concat([there[others], table], ignore_index=True), {**made, "circuits": circuits}


def _list(output: Output) -> None:
    """List the published data sets that come with the package, with their sources."""
    import pandas as pd

    from bgmodel.tables.shipped import every_set

    sets = every_set().values()
    rows = [{"name": one.name, "trials": one.trials, "participants": one.people,
             "strength": one.strength, "conditions": ", ".join(one.conditions), **one.about}
            for one in sets]  # fmt: skip
    output.show("\n\n".join(one.text() for one in sets), pd.DataFrame(rows))
