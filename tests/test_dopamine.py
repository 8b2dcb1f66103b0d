"""Dopamine: levels against closed forms, and learning by them, with controls that must fail."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel import Msprt, first_crossing, stream
from bgmodel.cli import main
from bgmodel.comparison.compare import Sweep, sweep
from bgmodel.comparison.levels import level_table
from bgmodel.decision import any_crossing
from bgmodel.dopamine import (
    THRESHOLD_NATS,
    criterion,
    decide_at_levels,
    decided_out,
    levels_between,
    playable_levels,
    usable_range,
    working_range,
)
from bgmodel.evidence import Evidence, gaussian_evidence
from bgmodel.files import read_table
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.level import after_errors, learn_level, level_outcomes, regret, scored_runs
from bgmodel.learning.policies import GaussianPolicy
from bgmodel.learning.reinforce import Learned, Learner, LearningStopped, learn
from bgmodel.learning.worlds import LevelOutcomes, switching
from bgmodel.tactile.task import SameDifferent, held_out_taps, source
from circuits.anatomy import circuit

XI, SEED, GAIN = 50.0, 61, 0.5
PLAYED = (0.75, 2.0)
MODEL = BasalGanglia(circuit("spiking_msprt"), "rate", GAIN, options={"dt_ms": 0.5})
LEVELS = playable_levels(MODEL, 9)


@pytest.mark.parametrize("channels", [2, 5])
@pytest.mark.parametrize("level", [0.7, 1.0, 1.3])
def test_a_level_shifts_out_by_the_gain_times_the_drive(channels, level):
    """In the exact circuit OUT = S - k y, as long as that is a rate: not below 0."""
    table = circuit("bogacz_gurney", channels)
    odds = 1.5
    y = table.reference_nats - np.log(channels) + odds * (1 - 1 / channels)
    s = y + np.log1p((channels - 1) * np.exp(-odds))
    assert decided_out(table, level, odds) == pytest.approx(max(s - level * y, 0.0), abs=1e-9)


@pytest.mark.parametrize("channels", [2, 4])
def test_normal_dopamine_decides_at_the_posterior_of_the_threshold(channels):
    """At level 1 OUT = -ln softmax(kappa L): its inverse, all other alternatives equal."""
    table = circuit("bogacz_gurney", channels)
    p = np.exp(-0.3)
    odds = np.log(p * (channels - 1) / (1 - p)) / GAIN
    expected = 1 / (1 + (channels - 1) * np.exp(-odds))
    assert criterion(table, 1.0, 0.3, GAIN) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("channels", "threshold"), [(2, THRESHOLD_NATS), (4, THRESHOLD_NATS), (4, 0.34)]
)
def test_the_fixed_point_spans_posteriors_from_75_to_99(channels, threshold):
    table = circuit("spiking_msprt", channels)
    low, high = working_range(table, threshold)
    found = [
        criterion(table, level, threshold, GAIN)
        for level in levels_between(1.01 * low, 0.99 * high, 12)
    ]
    assert np.all(np.diff(found) < 0)
    assert found[-1] < 0.75
    assert found[0] > 0.99
    # The edges are where they are said to be.
    lowest = decided_out(table, low, np.linspace(0, table.reach_nats, 500)).min()
    assert lowest == pytest.approx(threshold, abs=1e-3)
    if high < 2:
        assert decided_out(table, high, 0.0) == pytest.approx(threshold, abs=1e-3)


def test_a_learner_plays_what_evidence_decides_and_less_of_it_in_spikes():
    low, high = working_range(MODEL.circuit, THRESHOLD_NATS)
    assert usable_range(MODEL, THRESHOLD_NATS) == pytest.approx((1.02 * low, 0.98 * high))
    silence = np.zeros((1, 1, 2))
    for level in LEVELS[[0, -1]]:
        model = replace(MODEL, circuit=MODEL.circuit.dopamine(level))
        assert model.run_drive(silence, step_ms=500.0).output_nats.min() > THRESHOLD_NATS
    table = MODEL.circuit.with_neurons(100)
    spikes = replace(MODEL, circuit=table, engine="ensemble", seed=SEED, options={})
    least, most = usable_range(spikes, THRESHOLD_NATS)
    assert least == pytest.approx(1.02 * low)
    assert 1.1 < most < 0.9 * high
    # Fresh noise at the edge finds what was asked for.
    edge = replace(spikes, circuit=table.dopamine(most), seed=SEED + 1)
    assert any_crossing(edge.out_at_rest(400), THRESHOLD_NATS).mean() < 0.06
    # Fewer cells make more noise.
    few = replace(spikes, circuit=table.with_neurons(40))
    assert usable_range(few, THRESHOLD_NATS)[1] < most - 0.05
    with pytest.raises(ValueError, match="no level of dopamine takes spiking_msprt to"):
        usable_range(replace(few, circuit=few.circuit.with_neurons(5)), THRESHOLD_NATS)


def test_out_may_fall_and_rise_again_with_the_evidence():
    """In the exact circuit (1 - k) y grows with the odds: the lowest OUT lies between."""
    table = circuit("bogacz_gurney")
    low, _ = working_range(table, 0.3)
    out = decided_out(table, 0.96, np.linspace(0, 5, 50))
    assert out.min() < 0.3 < out[-1] + 0.2
    assert low < 0.96
    assert 0.5 < criterion(table, 0.96, 0.3, 1.0) < 1


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: working_range(MODEL.circuit, 3.0), "reads OUT between 0.0539 and 0.65 nats"),
        (lambda: working_range(MODEL.circuit, 0.0), "the threshold is 0"),
        (lambda: criterion(MODEL.circuit, 1.9, 0.3, 0.5), r"levels 0\.8. to 1\.7., got 1\.9"),
        (lambda: decide_at_levels(MODEL, None, [], 0.3), "levels must be one or more numbers"),
        (lambda: decide_at_levels(MODEL, None, [1.0, 1.0], 0.3), "each once"),
        (lambda: decide_at_levels(MODEL, None, [1.0, -0.5], 0.3), r"levels must lie in 0\.\.2"),
        (lambda: synthetic(10).rewards(0.0), "xi must be > 0 readings"),
        (lambda: switching([], 3), "worlds must hold one or more"),
        (lambda: GaussianPolicy(bounds=(2.0, 1.0)), "bounds must rise"),
        (lambda: GaussianPolicy(first_share=-1.0), "first_share must be > 0"),
        (lambda: short(start_level=3.0), r"start_level must lie in 0\.750\.\.2\.000, got 3"),
        (lambda: short(start_level=np.nan), "got nan"),
        (lambda: short(policy=GaussianPolicy()), r"what is played must lie in 0\.750\.\.2\.000"),
        (lambda: short(runs=0), "runs must be >= 1"),
        (
            lambda: LevelOutcomes(np.array([1.0, 0.9]), *[np.ones((2, 3))] * 2, np.zeros(2)),
            "levels must rise",
        ),
        (
            lambda: LevelOutcomes(np.array([1.0, 1.1]), *[np.ones((1, 3))] * 2, np.zeros(2)),
            "must be .levels, trials.",
        ),
        (
            lambda: MODEL.circuit.scaled("ctx", "D1", 1.2, channel=0).dopamine(1.1),
            "ctx->D1 differs from channel to channel",
        ),
    ],
)
def test_bad_input_gets_one_clear_sentence(call, says):
    with pytest.raises(ValueError, match=says):
        call()


def short(start_level=1.0, runs=2, **options):
    learner = Learner(episodes=600)
    options |= {"xi": XI, "seed": SEED, "name": "short", "learner": learner}
    return learn_level(synthetic(10), start_level=start_level, runs=runs, **options)


@pytest.fixture(scope="module")
def evidence():
    return gaussian_evidence(150, 60, 1 / np.sqrt(2), rng=stream(SEED, "knob"), step_ms=50.0)


@pytest.fixture(scope="module")
def swept(evidence):
    return decide_at_levels(MODEL, evidence, LEVELS[:7], THRESHOLD_NATS)


def test_a_sweep_of_levels_is_the_circuit_at_each_level(swept, evidence):
    assert np.all(np.diff(swept.settings) < 0)
    level = float(swept.settings[2])
    changed = BasalGanglia(MODEL.circuit.dopamine(level), "rate", GAIN, options=MODEL.options)
    alone = first_crossing(changed.run(evidence), THRESHOLD_NATS)
    assert np.array_equal(alone.choice, swept.choice[2])
    assert np.array_equal(alone.time_ms, swept.time_ms[2])


def test_more_dopamine_is_faster_and_less_accurate(swept, evidence):
    """150 trials: monotone, near the fixed point, and near the MSPRT in equal time."""
    test = sweep(Msprt(GAIN).run(evidence), evidence)
    options = {"circuit": MODEL.circuit, "gain": GAIN, "rng": stream(SEED, "boot")}
    table = level_table(swept, {"MSPRT": test}, latency_ms=56.0, **options)
    wide = table.pivot(index="level", columns="measure", values="value")
    assert np.all(np.diff(wide["mean_ms"]) < 0)
    assert np.all(np.diff(wide["criterion"]) < 0.01)
    both = wide.dropna()
    # Readings of d' = 1 carry the posterior past the bound, never below it but by latency.
    assert np.all(both["criterion"] > both["fixed_point"] - 0.03)
    assert wide["accuracy_gap"].abs().max() < 0.03


def test_the_gap_in_equal_time_sees_a_slower_decider(evidence):
    """The MSPRT itself has none; with times half as long again, or 100 ms late, it loses."""
    test = sweep(Msprt(GAIN).run(evidence), evidence)
    keep = np.searchsorted(test.posterior.mean(axis=1), [0.7, 0.75, 0.8, 0.85, 0.9])
    names = ("choice", "forced", "premature", "posterior")
    fields = {n: getattr(test, n)[keep] for n in names}
    gaps = {}
    for factor, late in ((1.0, 0.0), (1.5, 0.0), (1.0, 100.0)):
        slow = Sweep(np.linspace(1.6, 0.9, 5), time_ms=factor * test.time_ms[keep] + late, **fields)
        options = {"circuit": MODEL.circuit, "gain": GAIN, "rng": stream(SEED, "boot")}
        table = level_table(slow, {"MSPRT": test}, latency_ms=0.0, **options)
        rows = table[table["measure"] == "accuracy_gap"]
        gaps[factor, late] = rows["value"].to_numpy()
    assert np.abs(gaps[1.0, 0.0]).max() < 0.005
    assert gaps[1.5, 0.0].max() < -0.01
    assert gaps[1.0, 100.0].max() < -0.005


def synthetic(trials=4000, best=1.2):
    """Return outcomes whose mean reward is -10 (level - best)^2 - 5, noise beside it."""
    levels = np.linspace(*PLAYED, 26)
    noise = stream(SEED, "noise").normal(0, 1, (1, trials))
    steps = 10 * (levels[:, None] - best) ** 2 + 5 + noise
    return LevelOutcomes(levels, np.ones((26, trials), bool), steps, np.zeros(26))


def test_a_run_is_scored_where_fresh_trials_know_its_level_and_nowhere_else():
    made = synthetic()
    some = LevelOutcomes(made.levels[5:20], made.correct[5:20], made.steps[5:20], made.forced[5:20])
    ends = [made.levels[4], made.levels[10], made.levels[19]]
    table = scored_runs(ends, some, xi=XI, start_level=made.levels[0], first=made)
    assert np.isnan(table.loc[0, ["regret", "reward"]].to_numpy(float)).all()
    assert table["reward"][2] == pytest.approx(some.expected(ends[2], XI))
    wanted = (table["best_reward"] - table["reward"]) / table["best_reward"].abs()
    np.testing.assert_allclose(table["regret"], wanted)
    assert table["start_regret"].eq(float(regret(made.levels[0], made, XI))).all()


def test_level_outcomes_return_the_mean_reward_between_its_levels():
    made = synthetic()
    runs = 20_000
    rngs = [stream(SEED, "mean")] * runs
    world = made.environment(XI, rngs)
    for level in (0.76, 1.2, 1.713):
        found = world(0, np.full(runs, level))
        assert abs(found.mean() - made.expected(level, XI)) < 5 * found.std() / np.sqrt(runs)
    assert made.best(XI)[0] == pytest.approx(1.2, abs=0.03)
    wrong = LevelOutcomes(made.levels, ~made.correct, made.steps, made.forced)
    assert wrong.rewards(XI) == pytest.approx(made.rewards(XI) - XI)


@pytest.mark.parametrize("mean", [0.95, 1.6])
def test_the_gradient_of_the_level_agrees_with_the_finite_difference(mean):
    made = synthetic()
    policy = GaussianPolicy(bounds=PLAYED, first_share=0.06)
    runs = 40_000
    sd = policy.sd(0)
    rng = stream(SEED, "gradient", mean)
    played, gradient = policy.sample(policy.start(runs, mean), rng.standard_normal((runs, 1)), 0)
    r = made.environment(XI, [rng] * runs)(0, played)
    estimate = (r - r.mean()) * gradient[:, 0]
    x = np.linspace(mean - 6 * sd, mean + 6 * sd, 4001)

    def smoothed(mu):
        weights = norm.pdf(x, mu, sd)
        return (made.expected(np.clip(x, *PLAYED), XI) * weights).sum() / weights.sum()

    h = 1e-3
    exact = (smoothed(mean + h) - smoothed(mean - h)) / (2 * h)
    assert abs(exact) > 2
    assert abs(estimate.mean() - exact) < 4 * estimate.std() / np.sqrt(runs)


SHORT = Learner(episodes=6000)


@pytest.mark.parametrize("start", [0.8, 1.9])
def test_reward_finds_the_best_level_and_its_opposite_the_worst(start):
    made = synthetic()
    options = {"xi": XI, "start_level": start, "runs": 8, "seed": SEED, "name": start}
    learned = learn_level(made, learner=SHORT, **options)
    assert regret(start, made, XI) > 0.09
    assert regret(learned.learned, made, XI).max() < 0.03
    # Dopamine with the wrong sign: a rise for what was worse than expected.
    rngs = [stream(SEED, "flipped", run) for run in range(8)]
    world = made.environment(XI, rngs)
    flipped = learn(
        lambda k, played: -world(k, played) - 20,
        start,
        rngs=rngs,
        policy=GaussianPolicy(bounds=PLAYED),
        learner=SHORT,
    )
    assert regret(flipped.learned, made, XI).min() > 0.09


def test_credit_to_a_foreign_perturbation_teaches_nothing():
    """Each run is paid for what its neighbour played."""
    made, runs, start = synthetic(), 40, 1.8
    rngs = [stream(SEED, "shuffled", run) for run in range(runs)]
    world = made.environment(XI, rngs)
    learned = learn(
        lambda k, played: world(k, np.roll(played, 1)),
        start,
        rngs=[stream(SEED, "explored", run) for run in range(runs)],
        policy=GaussianPolicy(bounds=PLAYED),
        learner=Learner(episodes=2000, rate=0.01),
    )
    moved = learned.learned - start
    assert abs(moved.mean()) < 4 * moved.std() / np.sqrt(runs) + 0.02
    assert np.median(regret(learned.learned, made, XI)) > 0.3


@pytest.fixture(scope="module")
def tactile():
    readings = source(held_out_taps(), SameDifferent(), period_mm=1.5, fold=0)
    drawn = readings.draw(1500, 30, rng=stream(SEED, "tactile"), step_ms=50.0)
    model = replace(MODEL, options={"dt_ms": 0.5, "sample_ms": 5.0})
    return level_outcomes(model, drawn, LEVELS)


@pytest.mark.parametrize("start", [0.86, 1.69])
def test_dopamine_learns_the_level_of_a_circuit_that_touches(tactile, start):
    learned = learn_level(
        tactile,
        xi=XI,
        start_level=start,
        runs=6,
        seed=SEED,
        name="tactile",
    )
    assert regret(start, tactile, XI) > 0.1
    assert regret(learned.learned, tactile, XI).max() < 0.05
    # Tonic and phasic are two quantities: one has settled, the other has not.
    late = slice(-1000, None)
    assert learned.mean_played[:, late].std(axis=1).max() < 0.1
    assert learned.prediction_error[:, late].std(axis=1).min() > 1


def test_what_the_last_error_carries_over_slows_the_next_trial(tactile):
    """An error makes dopamine dip; a dip that lasts takes the next trial's level down."""
    found = {}
    for carried in (0.0, 0.5):
        learned = learn_level(
            tactile,
            xi=XI,
            start_level=1.5,
            runs=8,
            seed=SEED,
            name=carried,
            learner=Learner(episodes=8000, rate=0.001, half_episodes=np.inf, carried=carried),
        )
        found[carried] = after_errors(learned, XI)["slower"]
    error = found[0.0].std() / np.sqrt(8)
    assert abs(found[0.0].mean()) < 4 * error + 0.05
    assert found[0.5].min() > found[0.0].max()


def test_after_errors_takes_slow_drifts_off_and_nothing_else():
    rng = stream(SEED, "drift")
    steps = np.linspace(5, 25, 4000) + rng.normal(0, 1, (2, 4000))
    wrong = rng.random((2, 4000)) < 0.2
    steps += 5.0 * wrong  # errors are slow themselves: no reason for the next to be
    for slower in (0.0, 2.0):
        steps[:, 1:] += slower * wrong[:, :-1]
        learned = Learned(*[steps] * 2, -steps - XI * wrong, steps, steps[:, 0])
        found = after_errors(learned, XI)["slower"].to_numpy()
        assert found == pytest.approx(slower, abs=0.25)
    with pytest.raises(ValueError, match="xi must be longer than any trial"):
        after_errors(learned, 20.0)


def test_a_world_switches_and_each_has_its_trials():
    world = switching([lambda k, x: x, lambda k, x: -x], every=3)
    assert [world(k, np.array([1.0]))[0] for k in range(8)] == [1, 1, 1, -1, -1, -1, 1, 1]


def test_learning_that_cannot_go_on_keeps_what_it_had_reached():
    with pytest.raises(LearningStopped, match="a reward is not finite in episode 40") as stopped:
        learn(
            lambda k, x: np.where(k == 40, np.nan, -x),
            2.0,
            rngs=[stream(SEED, "stopped", run) for run in range(3)],
        )
    kept = stopped.value.learned
    assert kept.played.shape == (3, 40)
    assert np.isfinite(kept.played).all()
    assert kept.learned == pytest.approx(kept.mean_played[:, -1])


def test_reward_needs_the_truth(swept, evidence):
    with pytest.raises(ValueError, match="reward needs the truth"):
        LevelOutcomes.of(swept, Evidence(evidence.log_likelihood))


def test_the_command_learns_and_says_what_it_did(tmp_path, capsys):
    path = tmp_path / "dopamine.csv"
    small = ["--trials", "40", "--t-max", "10", "--levels", "4", "--runs", "2"]
    assert main(["circuit", "learn", str(path), *small, "--learner.episodes", "600"]) == 0
    assert "learned level" in capsys.readouterr().out
    table = read_table(path)
    assert list(table) == ["run", "episode", "tonic", "level", "reward", "phasic"]
    assert len(table) == 1200
    assert main(["circuit", "learn", str(path), *small, "--start-level", "3", "--force"]) == 2
    assert (
        "start_level must lie where spiking_msprt decides by evidence, 0.837..1.696, got 3"
        in capsys.readouterr().err
    )
