"""The ranking of losses."""

import pytest

from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.runs import RANKING, ranked
from bgmodel.explorer.state import State
from tests.explorer.helpers import small

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture(scope="module")
def last():
    """Return a state with an edit, and the last panel of its ranking."""
    state = small("macaque", "population", "lesion STN 10%")
    panels = [*ranked(state, workers=1)]
    return state, panels[-1]


def rows(panel):
    """Return the losses and the changes of the mean time."""
    (table,) = panel.tables
    return [(line, float(change.split()[0])) for line, change in table.to_numpy()[:, :2]]


def test_the_loss_that_slows_decisions_most_comes_first(last):
    _, panel = last
    changes = [change for _, change in rows(panel)]
    assert len(changes) > 10
    assert changes == sorted(changes, reverse=True)
    assert changes[0] > 0 > changes[-1]


def test_each_row_is_the_change_that_an_experiment_measures(last):
    state, panel = last
    line, change = rows(panel)[0]
    experiment = state.as_control().edited(line).experiment
    measures = experiment.run().measures
    chosen = (measures["condition"] == "change") & (measures["measure"] == "mean_ms")
    assert change == round(float(measures.loc[chosen, "value"].item()))


def test_a_loss_that_is_refused_is_left_out_with_its_reason(last):
    state, panel = last
    assert (panel.name, panel.key, panel.digest) == (RANKING, state.key, state.digest)
    assert not {"lesion ctx 10%", "lesion STN 10%"} & {line for line, _ in rows(panel)}
    assert "'lesion ctx 10%'" in panel.text


def test_a_control_that_is_refused_says_so():
    text = small("macaque", "population").experiment.to_toml()
    state = State(Experiment.from_text(text.replace("trials = 120", "trials = 60")))
    (panel,) = ranked(state, workers=1)
    assert panel.refused
