"""Chains: their diagnostics, and how they continue from a file."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.hierarchy import chains
from bgmodel.fitting.hierarchy.approximation import Expansion, Person
from bgmodel.fitting.hierarchy.chains import CHAINS, agreement, chains_entry, sampled
from bgmodel.fitting.hierarchy.group import Group
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler
from bgmodel.support.seeds import stream
from tests.fitting.hierarchy.known import wide
from tests.helpers import unwarned

SEED = 24_314


class Gaussian(Person):
    """A person with a Gaussian likelihood, who refuses another number of parameters."""

    def __init__(self, middle, size=1):
        object.__setattr__(self, "middle", np.full(size, middle))
        object.__setattr__(self, "scale", wide(size))

    def __call__(self, scaled):
        off = [x - middle for x, middle in zip(scaled, self.middle, strict=True)]
        return float(-2 * np.square(off).sum())


MIDDLES = np.array([-0.5, 0.0, 0.2, 0.7])
SAMPLER = Sampler(
    [Gaussian(each) for each in MIDDLES],
    Expansion(MIDDLES[:, None], np.zeros((4, 1)), np.full((4, 1, 1), 4.0)),
)
START = Group(np.zeros(1), np.ones(1))


def chain(values):
    """Return draws whose group has given means, and the rest independent."""
    rest = stream(SEED, len(values), float(values.sum())).normal(size=(len(values), 2, 1))
    return Draws(values[:, None], rest[:, 0] ** 2, rest, rest[..., 0])


def test_independent_draws_agree_and_shifted_chains_do_not():
    rng = stream(SEED, "chains")
    same = [chain(rng.normal(size=500)) for _ in range(CHAINS)]
    assert agreement(same).reached
    with unwarned():  # a standard deviation that does not move
        assert agreement([replace(each, sd=np.ones_like(each.sd)) for each in same]).reached
    apart = [chain(rng.normal(k, 1, size=500)) for k in range(CHAINS)]
    assert agreement(apart).rhat[0] > 1.1
    assert not agreement(apart).reached


FEW = 40


@pytest.fixture
def short(monkeypatch):
    """Make blocks and the warm-up short: runs resume in the same way for any length."""
    monkeypatch.setattr(chains, "BLOCK", FEW)
    monkeypatch.setattr(chains, "WARM_UP", FEW)


def test_chains_that_mix_slowly_are_discarded_and_their_surrogate_is_learned_again(
    short, monkeypatch, tmp_path
):
    monkeypatch.setattr(chains, "REMADE", (2 * FEW,))
    monkeypatch.setattr(chains, "POOR", 0.0)
    asked, told = {"seed": SEED, "most": 3 * FEW}, []
    sampled(SAMPLER, START, **asked, tell=told.append)
    assert not any("again" in each for each in told)
    monkeypatch.setattr(chains, "POOR", np.inf)
    told, kept = [], chains_entry(tmp_path, "a", {})
    once = sampled(SAMPLER, START, **asked, tell=told.append)
    assert sum("again" in each for each in told) == 1
    # Draws before are left out.
    assert sum("draws in each" in each for each in told) == 5
    assert len(once[0]) == 3 * FEW
    # The same, interrupted before the surrogate is learned again, and after.
    for blocks in (2, 4):
        told = []

        def stop(message, told=told, blocks=blocks):
            told.append(message)
            if sum("draws in each" in each for each in told) == blocks:
                raise KeyboardInterrupt

        kept.path.unlink(missing_ok=True)
        with pytest.raises(KeyboardInterrupt):
            sampled(SAMPLER, START, **asked, kept=kept, tell=stop)
        rest = sampled(SAMPLER, START, **asked, kept=kept)
        assert [each.scaled.tobytes() for each in rest] == [each.scaled.tobytes() for each in once]


BOTH = Expansion(np.tile(MIDDLES[:, None], 2), np.zeros((4, 2)), np.tile(4 * np.eye(2), (4, 1, 1)))
OTHERS = {
    "data": (replace(SAMPLER, people=[Gaussian(each + 0.01) for each in MIDDLES]), START),
    "parameters": (
        Sampler([Gaussian(each, 2) for each in MIDDLES], BOTH),
        Group(np.zeros(2), np.ones(2)),
    ),
}


RELATED = OTHERS["parameters"][0], replace(OTHERS["parameters"][1], correlation=np.eye(2))


@pytest.mark.parametrize(("sampler", "start"), [(SAMPLER, START), RELATED], ids=["one", "related"])
def test_an_interrupted_run_goes_on_with_the_same_bytes(short, tmp_path, sampler, start):
    kept = chains_entry(tmp_path / "pieces", "a", {})
    whole = sampled(sampler, start, seed=SEED, most=3 * FEW)
    sampled(sampler, start, seed=SEED, most=2 * FEW, kept=kept)
    assert kept.path.is_file()
    told = []
    rest = sampled(sampler, start, seed=SEED, most=3 * FEW, kept=kept, tell=told.append)
    assert not any("warm-up" in each for each in told)
    for name in ("scaled", "correlation"):
        both = [[getattr(each, name).tobytes() for each in some] for some in (rest, whole)]
        assert both[0] == both[1]


@pytest.mark.parametrize("what", OTHERS)
def test_chains_of_other_data_or_parameters_are_not_continued(short, tmp_path, what):
    kept = chains_entry(tmp_path, "a", {})
    sampled(SAMPLER, START, seed=SEED, most=FEW, kept=kept)
    (sampler, start), told = OTHERS[what], []
    sampled(sampler, start, seed=SEED, most=FEW, kept=kept, tell=told.append)
    assert any("warm-up" in each for each in told)
