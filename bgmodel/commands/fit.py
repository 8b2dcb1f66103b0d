"""The command ``fit``, which fits models to choice and response-time data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from bgmodel.commands.options import MANY, Workers, like, record_of, values
from bgmodel.commands.output import Output, check_whole, say, stages
from bgmodel.fit_trials import SIMULATED, fit_all, question
from bgmodel.fitting.fit_results import GroupFits
from bgmodel.fitting.settings import FitSettings, need_fit
from bgmodel.trials.files import listed
from bgmodel.trials.reader import OURS

OF_EVIDENCE = ("step_ms", "forced", "runs")
"""Settings of known evidence, given by --evidence."""
OF_SIMULATION = ("trials", "seed", "engine", "noise_nats")
"""Settings of simulated trials, given by --simulation."""
EACH_DRAWN = ", a figure for each participant"
GROUP_DRAWN = "; for each model figures of parameters and of the fit, and draws (.nc, for ArviZ)"


@like(FitSettings, "strength", "participant", "people", "vary", "formula", "free", "fix", "prior",
      "mechanism", "draws", "compare", participant=tuple[str, ...] | None)  # fmt: skip
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
        Models: constant_gap (the default), falling_gap, hyperbolic_gap, weibull_gap (two
        alternatives), msprt (the default), race, lca (more), or a circuit, by name or as a .toml
        file (macaque by default). Of rewarded choices: "no learning", q, "q, two rates", "logit q",
        confidence, "confidence, two rates", opal. Of stop-signal trials: constant_gap or a circuit.
        With --evidence: msprt, leaky_sum, run or a circuit.
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
        output.show(*listed())
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
        output.note(one.trials.summary())
        fits = fit_all(one, folder, workers=workers, note=output.note, stages=stages, write=True,
                       force=force)  # fmt: skip
    except KeyboardInterrupt:
        kept = "Finished fits and simulated trials are kept: the same command resumes there."
        raise KeyboardInterrupt(kept) from None
    if fits.comparison is not None:
        output.note("\n" + fits.comparison.summary())
    shown, drawn = fits.to_dataframe(), EACH_DRAWN
    text, facts = ["\n" + fits.summary().to_string()], {}
    if isinstance(fits, GroupFits):
        drawn = GROUP_DRAWN
        text.append(fits.notes())
        facts["effects"] = fits.effects().to_dict("records")
        facts["correlations"] = fits.correlations().to_dict("records")
    output.show("\n\n".join(filter(None, text)), shown, **facts)
    names = ", ".join(f"{name}.csv" for name in fits.tables())
    output.note(f"-> {folder}: {names}{drawn}")
