"""The ``bgmodel`` command: thin, its options come from the parameter classes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from tyro.conf import Positional

from bgmodel import files, tables
from bgmodel.decision import first_crossing
from bgmodel.learning import Learner
from bgmodel.policies import BernoulliPolicy, GaussianPolicy
from bgmodel.seeds import stream
from bgmodel.sprt import Msprt, Sprt, threshold_from_gap
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.grating import PERIODS_MM
from bgmodel.tactile.likelihood import Density
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin
from bgmodel.tactile.tips import Tip


@dataclass(frozen=True)
class Simulate:
    """Tap gratings with the simulated TacTip.

    Example: bgmodel simulate taps.npz --taps 100 --seed 1
    """

    output: Positional[Path]
    """Where the taps go, .npz."""
    taps: int = 1000
    """Taps of each grating."""
    periods_mm: tuple[float, ...] = PERIODS_MM
    """Periods of the gratings, mm."""
    yaw_deg: tuple[float, ...] | None = None
    """Yaws that taps take in turn, degrees; uniform in -90..90 if left out."""
    tip: Tip = field(default_factory=Tip)
    skin: Skin = field(default_factory=Skin)
    nuisance: Nuisance = field(default_factory=Nuisance)
    workers: int = 1
    """Processes for the contact library; they change no byte."""
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.library import LibraryPlan, contact_library
        from bgmodel.tactile.sensor import simulate

        _whole(taps=self.taps, workers=self.workers)
        _ending(self.output, ".npz")
        files.check_writable(self.output.parent)
        rng = stream(self.seed, "simulate")
        periods = np.repeat(self.periods_mm, self.taps)
        count = len(periods)
        yaw = rng.uniform(-90, 90, count) if self.yaw_deg is None else _in_turn(self.yaw_deg, count)
        plan = LibraryPlan(skin=self.skin, radius_mm=self.tip.radius_mm)
        library = contact_library(plan, workers=self.workers)
        taps = simulate(
            periods, yaw, rng=rng, tip=self.tip, nuisance=self.nuisance, library=library
        )
        about = files.provenance(
            self.seed, tip=self.tip, skin=self.skin, nuisance=self.nuisance, taps=self.taps
        )
        taps.save(self.output, about)
        print(f"{len(taps)} taps of {len(self.periods_mm)} gratings -> {self.output}")


@dataclass(frozen=True)
class Train:
    """Train a decoder on simulated taps, or on a folder of recordings.

    Examples: bgmodel train taps.npz decoder.safetensors --training.epochs 4 --seed 1;
    bgmodel train my_recordings edge.safetensors --edge --mm-per-px 0.33
    """

    taps: Positional[Path]
    """Taps from `bgmodel simulate`, or a folder of recordings with its targets csv."""
    output: Positional[Path]
    """Where the decoder goes, .safetensors."""
    edge: bool = False
    """Read the direction of an edge (-180..180) instead of a grating's orientation, with the
    settings found for edges in place of the training options."""
    mm_per_px: float | None = None
    """Scale of recordings, mm."""
    training: Training = field(default_factory=Training)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.decoder import EDGE, train

        _ending(self.output, ".safetensors")
        files.check_writable(self.output.parent)
        training = EDGE if self.edge else self.training
        taps, about = _taps(self.taps, self.mm_per_px)
        decoder = train(taps, seed=self.seed, training=training, about={"taps": about})
        decoder.save(self.output)
        best = min(row["mae_deg"] for row in decoder.history)
        print(f"validation error {best:.1f} degrees -> {self.output}")


@dataclass(frozen=True)
class Decode:
    """Read the angle of every tap: of simulated taps, or of a folder of recordings.

    Example: bgmodel decode decoder.safetensors taps.npz decoded.parquet
    """

    decoder: Positional[Path]
    """A decoder from `bgmodel train`."""
    taps: Positional[Path]
    """Taps from `bgmodel simulate`, or a folder of recordings with its targets csv."""
    output: Positional[Path]
    """Where the table goes, .parquet or .csv."""
    mm_per_px: float | None = None
    """Scale of recordings, mm."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.decoder import Decoder

        _ending(self.output, ".parquet", ".csv")
        files.check_writable(self.output.parent)
        decoder = Decoder.load(self.decoder)
        taps, about = _taps(self.taps, self.mm_per_px, rest=decoder.rest_mm)
        table = taps.labels.assign(**decoder.decode(taps))
        if "image" in table:
            table["image"] = table["image"].map(lambda path: Path(path).name)
        files.write_table(table, self.output, taps=about, decoder=decoder.about)
        print(f"{len(table)} taps decoded -> {self.output}")


@dataclass(frozen=True)
class Decide:
    """Decide by the sequential test: on tactile evidence, or on a table of your own.

    A table has one row a reading with the columns trial, step, ll_<hypothesis> (natural log
    likelihoods; two or more such columns) and, if known, truth.

    Examples: bgmodel decide decisions.csv --period-mm 2 --delta 4;
    bgmodel decide decisions.parquet --evidence mine.csv --posterior 0.95
    """

    output: Positional[Path]
    """Where the trial table goes, .parquet or .csv."""
    evidence: Path | None = None
    """A table of log-likelihoods, .csv or .parquet; tactile evidence if left out."""
    delta: float | None = None
    """Gap between the two bounds of the SPRT, nats (two hypotheses); 4 if no criterion is given."""
    posterior: float | None = None
    """Posterior probability at which the MSPRT stops, instead of delta."""
    prior: tuple[float, ...] | None = None
    """Prior probabilities; equal if left out."""
    task: Literal["same-different", "orientation"] = "same-different"
    """Tactile question: are two gratings the same, or which of N orientations is it."""
    orientations: int = 4
    """N for the orientation task, 2..8."""
    period_mm: float = 2.0
    """Period of the tactile grating, mm."""
    fold: int = 0
    """Which sixth of the held-out taps is scored, 0..5."""
    trials: int = 1000
    """Tactile trials."""
    t_max: int = 30
    """Most readings in a tactile trial."""
    step_ms: float = 500.0
    """Time between readings, ms; assumed."""
    onset_ms: float = 0.0
    """Time from the start of a trial of your own table to the onset of evidence, ms."""
    forced: bool = True
    """Whether the deadline forces a response."""
    density: Density = field(default_factory=Density)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        _ending(self.output, ".parquet", ".csv")
        files.check_writable(self.output.parent)
        self._check()
        evidence, names = self._evidence()
        test, threshold, model = self._test(evidence.hypotheses)
        decision = first_crossing(test.run(evidence), threshold, forced=self.forced)
        table = tables.trial_table(decision, evidence, seed=self.seed, model=model, names=names)
        files.write_table(table, self.output, seed=self.seed, command=_asked(self))
        known = evidence.truth is not None
        accuracy = f"accuracy {table['correct'].mean():.3f}" if known else "no truth given"
        print(
            f"{len(table)} trials, {accuracy}, mean readings {np.nanmean(decision.steps):.2f}, "
            f"undecided {table['undecided'].sum()} -> {self.output}"
        )

    def _check(self) -> None:
        """Refuse what contradicts itself, before long work starts."""
        if self.posterior is not None and not 0 < self.posterior < 1:
            raise ValueError(f"posterior must lie between 0 and 1, got {self.posterior}")
        if self.posterior is not None and self.delta is not None:
            raise ValueError("delta and posterior are two ways to say one thing: give one of them")
        threshold_from_gap(0.0 if self.delta is None else self.delta)
        if self.evidence is None:
            return
        default = Decide(self.output)
        for name in ("task", "orientations", "period_mm", "fold", "trials", "t_max", "density"):
            if getattr(self, name) != getattr(default, name):
                raise ValueError(
                    f"{name} is for tactile evidence, it says nothing about {str(self.evidence)!r}"
                )

    def _test(self, hypotheses: int) -> tuple[Sprt | Msprt, float, str]:
        if self.posterior is not None:
            return Msprt(), float(-np.log(self.posterior)), f"msprt posterior={self.posterior:g}"
        if hypotheses != 2:
            raise ValueError(f"a gap is for 2 hypotheses: with {hypotheses}, give --posterior")
        gap = 4.0 if self.delta is None else self.delta
        return Sprt(), float(threshold_from_gap(gap)), f"sprt delta={gap:g}"

    def _evidence(self):
        if self.evidence is not None:
            return tables.evidence_from_table(
                files.read_table(self.evidence),
                prior=self.prior,
                onset_ms=self.onset_ms,
                step_ms=self.step_ms,
            )
        from bgmodel.tactile.task import Orientations, SameDifferent, held_out_taps, source

        same = self.task == "same-different"
        task = SameDifferent() if same else Orientations(self.orientations)
        readings = source(
            held_out_taps(), task, period_mm=self.period_mm, fold=self.fold, density=self.density
        )
        rng = stream(self.seed, "decide")
        drawn = readings.draw(
            self.trials, self.t_max, rng=rng, prior=self.prior, step_ms=self.step_ms
        )
        return drawn, list(task.names)


@dataclass(frozen=True)
class Learn:
    """Learn the gap from reward by REINFORCE with baseline, beside the exact optimum.

    Example: bgmodel learn learning.parquet --period-mm 2 --xi 50 --start-delta 0.5
    """

    output: Positional[Path]
    """Where the table of trials goes, .parquet or .csv."""
    period_mm: float = 2.0
    """Period of the grating, mm."""
    xi: float = 50.0
    """Cost of an error, readings."""
    start_delta: float = 0.5
    """Gap at the start, nats, 0..8."""
    runs: int = 10
    """Independent repeats."""
    fold: int = 0
    """Which sixth of the held-out taps is learned on, 0..5."""
    t_max: int = 30
    """Most readings in a trial."""
    policy: Literal["gaussian", "bernoulli"] = "gaussian"
    """Gaussian over the gap, or the Bernoulli units of Lepora 2016."""
    learner: Learner = field(default_factory=Learner)
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.study import learn_grating

        _ending(self.output, ".parquet", ".csv")
        files.check_writable(self.output.parent)
        _whole(runs=self.runs, t_max=self.t_max)
        policy = GaussianPolicy() if self.policy == "gaussian" else BernoulliPolicy()
        table, summary = learn_grating(
            self.period_mm,
            xi=self.xi,
            start_delta=self.start_delta,
            runs=self.runs,
            fold=self.fold,
            t_max=self.t_max,
            policy=policy,
            learner=self.learner,
            seed=self.seed,
        )
        files.write_table(table, self.output, seed=self.seed, command=_asked(self), summary=summary)
        learned = np.asarray(summary["learned_delta"])
        print(
            f"learned delta {learned.mean():.2f} (sd {learned.std():.2f} over {self.runs} runs), "
            f"exact optimum {summary['optimal_delta']:.2f}, regret "
            f"{100 * np.mean(summary['regret']):.2f} % -> {self.output}"
        )


@dataclass(frozen=True)
class Figures:
    """Draw every figure that is not drawn yet, from a checkout of the project.

    Example: bgmodel figures --fast
    """

    targets: Positional[tuple[str, ...]] = ()
    """Names of figures, such as fig4a, or files to make; all if left out."""
    fast: bool = False
    """A coarse run, under 3 minutes, into figures/fast."""
    cores: int = 2
    """Jobs at a time; they change no byte."""
    recordings: Path | None = None
    """Folder of real taps for figure R1; BGMODEL_RECORDINGS if left out."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.recordings import find_recordings

        _whole(cores=self.cores)
        if not Path("figures/Snakefile").is_file():
            raise ValueError("figures are drawn in a checkout of the project: figures/Snakefile")
        try:
            import snakemake  # noqa: F401
        except ImportError as error:
            raise ImportError('figures need Snakemake: pip install "bgmodel[figures]"') from error
        found = find_recordings(self.recordings)
        if found is None:
            print("figure R1 is left out: no recordings (--recordings or BGMODEL_RECORDINGS)")
            if "figR1" in self.targets:
                raise ValueError("figR1 needs recordings: --recordings or BGMODEL_RECORDINGS")
        command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile"]
        command += ["--cores", str(self.cores), "--rerun-incomplete"]
        command += ["--quiet", "rules", "host", "reason"]
        command += ["--config", f"fast={int(self.fast)}", f"recordings={found or ''}"]
        done = subprocess.run([*command, "--", *(self.targets or ["all"])], check=False)
        if done.returncode:
            raise SystemExit(done.returncode)


ABOUT = "From a tactile tap to a learned decision: simulate, train, decode, decide, learn, draw."
COMMANDS = (Simulate, Train, Decode, Decide, Learn, Figures)


def main(arguments: list[str] | None = None) -> int:
    """Run ``bgmodel``; errors of use are one sentence on stderr, with exit status 2."""
    names: Any = {kind.__name__.lower(): kind for kind in COMMANDS}
    command: Callable[[], None] = tyro.extras.subcommand_cli_from_dict(
        names, prog="bgmodel", description=ABOUT, args=arguments
    )
    try:
        command()
    except (ValueError, ImportError, OSError) as error:
        print(f"bgmodel: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"bgmodel: stopped. {stop}", file=sys.stderr)
        return 130
    return 0


def _taps(path: Path, mm_per_px: float | None, rest: np.ndarray | None = None):
    """Return taps and their provenance, from a file or from a folder of recordings."""
    if not path.is_dir():
        from bgmodel.tactile.taps import Taps

        return Taps.load(path)
    if mm_per_px is None:
        raise ValueError("recordings need their scale: --mm-per-px, mm a pixel")
    from bgmodel.tactile.recordings import read_taps

    taps = read_taps(path, mm_per_px=mm_per_px, rest=rest)
    return taps, {"recordings": path.name, "mm_per_px": mm_per_px}


def _asked(command: Any) -> dict[str, Any]:
    """Return a command's options but for where its result goes."""
    options = {field.name: getattr(command, field.name) for field in fields(command)}
    return {name: value for name, value in options.items() if name != "output"}


def _ending(path: Path, *allowed: str) -> None:
    if path.suffix not in allowed:
        raise ValueError(f"output must end in {' or '.join(allowed)}, got {str(path)!r}")


def _whole(**values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}")


def _in_turn(values: tuple[float, ...], count: int) -> np.ndarray:
    return np.resize(np.asarray(values, dtype=float), count)
