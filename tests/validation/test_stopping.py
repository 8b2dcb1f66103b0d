"""Stopping at full size: the closed form against spikes, the stop-signal reaction time, lesions."""

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.deciding.decision import first_crossing
from bgmodel.stopping.inputs import StopSignal, closed_form, decide_with_stop, step_response

pytestmark = pytest.mark.validate
POSTERIOR = 0.82
TASK = {"d_prime": 0.35, "t_max": 150, "step_ms": 10}


def outcomes(channels, engine, signal, ssd, trials, seed):
    """Return the outcomes of full runs and of the closed form, on the same evidence and noise."""
    evidence = bg.gaussian_evidence(trials, channels=channels, seed=seed, **TASK)
    model = bg.BasalGanglia(bg.load_circuit("macaque", channels), engine, seed=seed + 1)
    level = model.threshold(None, POSTERIOR)
    delays = np.append(np.nan, np.full(trials - 1, float(ssd)))
    full = decide_with_stop(model, evidence, delays, signal, threshold=level)
    added = step_response(model, signal, time_ms=1510)[1]
    same = 0
    for part, _, trace in model.batches(evidence):
        here = delays[part.trial_numbers]
        made = first_crossing(
            closed_form(trace, here, signal, added), level, forced=False, checked=False
        )
        closed = (made.choice >= 0) == full.responded[part.trial_numbers]
        same += int(closed[~np.isnan(here)].sum())
    return full, same / (trials - 1)


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize(
    ("amount", "duration", "least"),
    [
        (0.5, np.inf, 0.99),
        (1.0, np.inf, 0.99),
        (1.0, 100.0, 0.98),
        (0.3, np.inf, 0.95),
    ],
)
def test_the_closed_form_is_what_spikes_do(channels, amount, duration, least):
    """The last amount is one and a half times the threshold of 0.198 nats.

    So near it noise makes responses, and in spikes it depends on OUT: 0.952 and 0.988 are the same.
    The delay leaves responses to a third or more of the stop trials, and stops to others.
    """
    signal = StopSignal(amount_nats=amount, duration_ms=duration)
    ssd_ms = {2: 300, 4: 800}[channels]
    full, same = outcomes(channels, "spikes", signal, ssd_ms, 2000, seed=81_001)
    assert full.p_respond > 0.2
    assert same >= least, f"{same:.4f}"


def ssrt_of(model, evidence, signal, ssd, go_ms):
    delays = np.append(np.nan, np.full(evidence.trials - 1, float(ssd)))
    stopped = decide_with_stop(model, evidence, delays, signal, posterior=POSTERIOR)
    return np.quantile(go_ms, stopped.p_respond) - ssd


@pytest.mark.parametrize("amount", [0.5, 1.0])
def test_the_stop_signal_reaction_time_does_not_depend_on_the_delay(amount):
    """Context independence (Logan & Cowan 1984): within 5 ms over delays of 200 to 500 ms."""
    evidence = bg.gaussian_evidence(10_000, seed=82_001, **TASK)
    model = bg.BasalGanglia("macaque", seed=82_002)
    go = model.decided(evidence, model.threshold(None, POSTERIOR), forced=False)
    go_ms = np.where(go.choice >= 0, go.time_ms, np.inf)
    signal = StopSignal(amount_nats=amount)
    ssrt_ms = [ssrt_of(model, evidence, signal, ssd, go_ms) for ssd in (200, 300, 400, 500)]
    assert np.ptp(ssrt_ms) <= 5, ssrt_ms


@pytest.mark.parametrize("amount", [0.3, 0.4, 0.5, 0.6])
def test_the_loss_of_stn_at_which_stopping_fails_is_that_of_the_closed_form(amount):
    """With the signal at the onset, p(respond) passes 0.5 at a loss of 1 - exp(threshold - A).

    By rates without noise. With the noise of populations it passes 0.05 to 0.07 earlier, as if the
    threshold were 0.07 nats higher: in 1.5 s noise carries OUT that far. Beyond a loss of 0.375,
    OUT at rest is below the threshold.
    """
    evidence = bg.gaussian_evidence(500, seed=84_001, **TASK)
    losses = np.arange(0.0, 0.36, 0.025)
    intact = bg.load_circuit("macaque")
    level = bg.BasalGanglia(intact).threshold(None, POSTERIOR)
    p_respond = []
    for loss in losses:
        model = bg.BasalGanglia(intact.lesion("STN", loss), "rate")
        stop = np.append(np.nan, np.zeros(evidence.trials - 1))
        signal = StopSignal(amount_nats=amount)
        p_respond.append(decide_with_stop(model, evidence, stop, signal, threshold=level).p_respond)
    passed = float(np.interp(0.5, p_respond, losses))
    assert passed == pytest.approx(1 - np.exp(level - amount), abs=0.05), p_respond
