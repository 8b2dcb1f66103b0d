"""Long checks of what the project claims: make validate.

Seeds here (scoring seeds, 101 and up) played no part in choosing any number.
"""

import time
from functools import partial

import numpy as np
import pytest

from bgmodel import Msprt, Sprt, criterion_from_gap, first_crossing, stream, threshold_from_gap
from bgmodel.evidence import gaussian_evidence
from bgmodel.integrators.sprt import Stream
from bgmodel.learning.gap import fold_sources, increments, regret_on_fresh_trials
from bgmodel.learning.policies import GaussianPolicy
from bgmodel.learning.reinforce import Learner, learn
from bgmodel.learning.worlds import trials_of
from bgmodel.tactile.task import FOLDS, SameDifferent, Source, held_out_taps, tap_pool
from bgmodel.theory.sprt import gaussian_pair, optimal_delta, reward_curve, sprt

pytestmark = pytest.mark.validate
XI, T_MAX = 50.0, 30
SCORING_SEEDS = range(101, 121)


def test_two_hypothesis_msprt_is_the_sprt_in_a_million_trials():
    deltas = np.linspace(0, 8, 33)
    readings = fold_sources(held_out_taps(), 2.0)[0]
    for part in range(50):
        rng = stream(101, "equality", part)
        if part % 2:
            evidence = readings.draw(20_000, T_MAX, rng=rng)
        else:
            evidence = gaussian_evidence(20_000, 50, 0.4, rng=rng)
        a = first_crossing(Sprt().run(evidence), threshold_from_gap(deltas))
        b = first_crossing(Msprt().run(evidence), criterion_from_gap(deltas))
        assert (a.choice != b.choice).sum() + (a.time_ms != b.time_ms).sum() == 0


def test_streaming_equals_batch_on_tactile_evidence():
    readings = fold_sources(held_out_taps(), 2.0)[0]
    evidence = readings.draw(2000, T_MAX, rng=stream(101, "streaming"))
    for test, threshold in ((Sprt(), -2.0), (Msprt(), float(-np.log(0.95)))):
        batch = first_crossing(test.run(evidence), threshold)
        for n in range(evidence.trials):
            trial = Stream(test, threshold, t_max=T_MAX)
            for reading in evidence.log_likelihood[n]:
                if trial.update(reading) is not None:
                    break
            assert (trial.choice, trial.readings) == (batch.choice[n], batch.steps[n])


def test_discrete_simulation_against_the_exact_solution():
    """|z| < 4 for error rate and mean time at 1e6 trials over a grid of (d, theta)."""
    trials, t_max = 1_000_000, 200
    thetas = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0])
    for d in (0.5, 1.0, 2.0):
        sums = np.zeros((4, len(thetas)))
        for part in range(50):
            rng = stream(101, "exact", d, part)
            evidence = gaussian_evidence(trials // 50, t_max, d / np.sqrt(2), rng=rng)
            decision = first_crossing(Sprt().run(evidence), threshold_from_gap(2 * thetas))
            wrong = decision.choice != evidence.truth
            sums += [wrong.sum(1), decision.steps.sum(1), (decision.steps**2).sum(1), 0 * thetas]
        error, steps, squares, _ = sums / trials
        exact = sprt(*gaussian_pair(d), 2 * thetas, t_max=t_max)
        p = exact.error_rate
        z_error = (error - p) / np.sqrt(p * (1 - p) / trials)
        z_steps = (steps - exact.mean_steps) / np.sqrt((squares - steps**2) / trials + 1e-30)
        print(f"d {d}: z of error {np.round(z_error, 1)}, of time {np.round(z_steps, 1)}")
        assert np.abs(z_error).max() < 4
        assert np.abs(z_steps[steps > 1]).max() < 4


@pytest.mark.parametrize("start", [0.5, 7.5])
@pytest.mark.parametrize("period", [1.5, 2.0, 2.5])
def test_learning_ends_within_two_per_cent_of_the_exact_optimum(period, start):
    """18 of 20 scoring seeds, on fold 0; a start within 6 % is flat, and passes nothing."""
    # On 2.5 mm errors are so rare that their rate takes more trials, and wider trials, to measure.
    slow = period == 2.5
    long = Learner(episodes=100_000)
    learner = Learner(episodes=200_000, half_episodes=3000) if slow else long
    policy = GaussianPolicy(last_share=0.0625, half_episodes=20_000) if slow else GaussianPolicy()
    readings = fold_sources(held_out_taps(), period)[0]
    pair = increments(readings)
    optimum = optimal_delta(*pair, XI, t_max=T_MAX)
    start_regret = -float(reward_curve(*pair, start, XI, t_max=T_MAX)) / optimum.cost - 1
    name = ("validation", period, start)
    draws = [
        partial(readings.draw, steps=T_MAX, rng=stream(seed, *name, "trials"))
        for seed in SCORING_SEEDS
    ]
    delta = learn(
        trials_of(draws, XI),
        start,
        rngs=[stream(seed, *name, "explore") for seed in SCORING_SEEDS],
        policy=policy,
        learner=learner,
    ).learned
    regrets = [
        regret_on_fresh_trials(
            delta[[i]], readings, optimum, xi=XI, t_max=T_MAX, seed=seed, name=name
        )[0]
        for i, seed in enumerate(SCORING_SEEDS)
    ]
    exact = -reward_curve(*pair, delta, XI, t_max=T_MAX) / optimum.cost - 1
    passed, surely = np.sum(np.array(regrets) < 0.02), np.sum(np.array(exact) < 0.02)
    print(
        f"{period} mm from {start}: start regret {start_regret:.3f}, within 2 % {passed}/20 "
        f"(exact {surely}/20), worst {max(exact):.3f}"
    )
    if start_regret < 0.06:
        pytest.skip(f"{period} mm from {start} is flat: the start is within 6 %")
    assert passed >= 18


def test_smooth_grating_is_at_chance():
    """0 mm: 50 % lies in a simultaneous interval over gaps, bootstrapped over taps in each fold."""
    deltas = np.linspace(0, 8, 9)
    taps = held_out_taps()
    task = SameDifferent()
    for period in (0.0, 1.0):
        pools = tap_pool(taps, task, period)
        sources = fold_sources(taps, period)

        def accuracy(chosen, sources=sources, pools=pools):
            values = []
            for fold, own in enumerate(sources):
                part = [p[np.arange(len(p)) % FOLDS == fold] for p in pools]
                part = [p[i] for p, i in zip(part, chosen(fold, part), strict=True)]
                logs = [own.likelihood(x) for x in task.readings(part)]
                again = Source(logs, task.names, own.likelihood)
                values.append(1 - sprt(*increments(again), deltas, t_max=T_MAX).error_rate)
            return np.mean(values, axis=0)

        whole = accuracy(lambda fold, part: [np.arange(len(p)) for p in part])
        boot = []
        for k in range(60):
            rng = stream(101, "bootstrap", period, k)
            boot.append(
                accuracy(lambda f, part, rng=rng: [rng.integers(len(p), size=len(p)) for p in part])
            )
        spread = np.std(boot, axis=0) + 1e-12
        widest = np.percentile(np.abs((np.array(boot) - np.mean(boot, axis=0)) / spread).max(1), 95)
        shrinks = [round(s.likelihood.shrink, 2) for s in sources]
        print(f"{period} mm: {np.round(whole, 3)} +- {np.round(widest * spread, 3)}, {shrinks}")
        if period == 0:
            assert (np.abs(whole - 0.5) <= widest * spread + 1e-9).all()


def test_validation_error_of_three_training_seeds():
    """25 to 30 degrees pooled over the eight stimuli; 27.5 with the real sensor (Pestell 2022)."""
    from bgmodel.tactile.decoder import train
    from bgmodel.tactile.grating import PERIODS_MM
    from bgmodel.tactile.sensor import simulate

    for seed in (101, 102, 103):
        rng = stream(seed, "validation taps")
        periods = np.repeat(PERIODS_MM, 1000)
        start = time.process_time()
        taps = simulate(periods, rng.uniform(-90, 90, len(periods)), rng=rng)
        history = train(taps, seed=seed).history
        best = min(row["mae_deg"] for row in history)
        print(f"seed {seed}: {best:.2f} degrees, {time.process_time() - start:.0f} CPU-s")
        assert 25 <= best <= 30


def test_real_taps_are_read_within_five_degrees():
    from bgmodel.tactile.decoder import EDGE, train
    from bgmodel.tactile.networks import wrapped
    from bgmodel.tactile.recordings import find_recordings, read_taps

    folder = find_recordings(None)
    if folder is None:
        pytest.skip("no recordings given: set BGMODEL_RECORDINGS")
    fitted = read_taps(folder / "csv_train", mm_per_px=0.33)
    held = read_taps(folder / "csv_val", mm_per_px=0.33, rest=fitted.rest_mm)
    for seed in (101, 102, 103):
        read = train(fitted, seed=seed, training=EDGE).decode(held)["edge_deg"]
        error = wrapped(read - held.labels["yaw_deg"].to_numpy(), 360)
        print(f"seed {seed}: yaw error sd {error.std():.2f} degrees")
        assert error.std() <= 5
