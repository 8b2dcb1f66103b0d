"""What every user of the store relies on: a file is whole, of this version and key, or absent."""

import threading
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.fit_results import fit_entry
from bgmodel.fitting.hierarchy.chains import chains_entry
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import Misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.person_fit import Fit
from bgmodel.fitting.posterior import Directions
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.crossings import FirstPassageTimes
from bgmodel.fitting.simulated.error import SimulationErrors
from bgmodel.support.files import checksum_entry
from bgmodel.sweeps import shards
from bgmodel.sweeps.plan import Plan
from bgmodel.tactile import library
from circuits import store
from circuits.anatomy import load_circuit
from circuits.store import cached
from figures import pieces
from tests.damage import DAMAGES
from tests.drawn import drawn
from tests.helpers import refused
from tests.tactile.plans import TINY

RNG = np.random.default_rng(24_711)
TABLE = pd.DataFrame({"rt": RNG.normal(size=40), "who": [f"p{k % 7}" for k in range(40)]})
ARRAYS = {"x": np.arange(5.0), "of": np.zeros((0, 2), np.int16), "name": np.array("one")}
LIKELIHOOD = likelihood_of(
    GapModel(), design_of(drawn(GapModel(), [0.4], 20, 71, seconds=2.0, sensitivity=9.0, bound=0.6))
)
VECTOR = LIKELIHOOD.freedom.start
FIT = Fit(
    Optimum(LIKELIHOOD, VECTOR, -3.0, 7),
    Directions(LIKELIHOOD.freedom.names, VECTOR, np.eye(len(VECTOR))),
    SimulationErrors(0.0, np.zeros(len(VECTOR))), Misfit(np.zeros(1), np.ones(1), {}),
)  # fmt: skip
MODEL = CircuitModel(load_circuit("macaque", 2), "rate")
BINS, CHOICE = RNG.integers(0, 9, (2, 60, 30)).astype("int16")
DECIDED = BINS, CHOICE, RNG.normal(size=(60, 30))
PASSAGES = FirstPassageTimes(MODEL.thresholds_nats, np.arange(7.0), *DECIDED)
CELLS = TINY.stored_cells
FIELDS = {
    period: RNG.normal(size=(TINY.solved_phases(period), 2, CELLS, CELLS, 5)).astype(np.float32)
    for period in TINY.periods_mm
}
(POINT,) = Plan(engine="algebra", grid={"lesion STN": (0.0,)}).all_points()
SCORE = pieces.Score("test", 1, (2,), lambda *_: (), dict)
USERS = {
    "filters": (lambda _: cached("tables", "sources", "key"), ARRAYS),
    "states": (lambda _: cached("states", "sources", "key", most=9), ARRAYS),
    "fits": (lambda folder: fit_entry(folder, "a/b", {"k": [0.1]}, LIKELIHOOD), (FIT, ["it is"])),
    "steps": (lambda folder: checksum_entry(folder / "a", {"k": 1}), "e3b0c442"),
    "crossings": (lambda folder: replace(MODEL, folder=folder).entry(()), PASSAGES),
    "chains": (lambda folder: chains_entry(folder, "a", {"k": 1}), ARRAYS),
    "shards": (lambda folder: shards.entry(POINT.shards()[0], folder), ARRAYS),
    "contacts": (lambda _: library.entry(TINY), FIELDS),
    "scores": (
        lambda folder: SCORE.entry(pieces.Piece("kind", "a/b", 9, 1, dict), folder, False),
        TABLE.round(3),
    ),
}


@pytest.fixture(params=USERS)
def user(request, tmp_path, monkeypatch):
    """Return the entry of a user in an empty folder, and a value."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("BGMODEL_CACHE", str(tmp_path / "store"))
    make, value = USERS[request.param]
    return make(tmp_path / "store"), value


def same(entry, one, other):
    """Whether two values have the same bytes."""

    def plain(value):
        arrays = {name: np.asarray(each) for name, each in entry.pack(value).items()}
        return {name: (a.dtype, a.shape, a.tobytes()) for name, a in arrays.items()}

    return plain(one) == plain(other)


def test_a_value_is_read_back_and_has_the_same_bytes_again(user):
    entry, value = user
    assert entry.get() is None
    entry.put(value)
    contents = entry.path.read_bytes()
    assert same(entry, entry.get(), value)
    entry.put(entry.get())
    assert entry.path.read_bytes() == contents
    assert [*entry.path.parent.iterdir()] == [entry.path]


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_counts_as_absent_until_it_is_written_again(user, damage):
    entry, value = user
    entry.put(value)
    entry.path.write_bytes(damage(entry.path.read_bytes()))
    there = entry.get()
    assert there is None or same(entry, there, value)  # some bytes of a file mean nothing
    assert same(entry, entry.once(lambda: value), value)
    assert same(entry, entry.get(), value)


@pytest.mark.parametrize("changed", [{"version": "another"}, {"key": {"another": 1}}])
def test_another_version_or_key_overwrites_nothing_and_is_not_read(user, changed):
    entry, value = user
    entry.put(value)
    contents, other = entry.path.read_bytes(), replace(entry, **changed)
    assert other.get() is None
    other.put(value)
    assert entry.path.read_bytes() == contents
    other.path.write_bytes(contents)
    assert other.get() is None


def test_of_two_that_need_a_value_at_once_one_computes_it(user, monkeypatch):
    entry, value = user
    made, results, waits = [], [], threading.Event()
    locked = store.locked

    def told(path):
        if made:
            waits.set()
        return locked(path)

    def make():
        made.append(1)
        second.start()
        assert waits.wait(60)
        return value

    monkeypatch.setattr(store, "locked", told)
    second = threading.Thread(target=lambda: results.append(entry.once(make)))
    results.append(entry.once(make))
    second.join(60)
    assert len(made) == 1
    assert all(same(entry, each, value) for each in results)
    assert [*entry.path.parent.iterdir()] == [entry.path]


def test_a_full_disk_is_a_sentence_or_costs_only_time(user, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    entry, value = user
    monkeypatch.setattr(np, "savez", full)
    if entry.spare:
        assert same(entry, entry.once(lambda: value), value)
    else:
        with refused("folder"):
            entry.once(lambda: value)
    assert not [*entry.path.parent.glob(".*")]
    assert entry.get() is None


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_computed(user, tmp_path):
    entry, value = user
    (tmp_path / "file").touch()
    entry = replace(entry, folder=tmp_path / "file" / "below")
    if entry.spare:
        assert same(entry, entry.once(lambda: value), value)
    else:
        with refused("folder"):
            entry.once(None)


def test_without_a_folder_nothing_is_stored(user, tmp_path):
    entry, value = user
    entry = replace(entry, folder=None)
    entry.put(value)
    assert entry.get() is None
    assert entry.once(lambda: value) is value
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
