"""Counter-based noise: its test vector, its statistics, and that nothing depends on the company."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, chi2, norm

from circuits import anatomy
from circuits.dynamics import noise
from circuits.dynamics.ticks import cell_factors, starting_state
from circuits.dynamics.wiring import fan_in, wire

TICKS, NEURONS = 2048, 512
ALPHA = 1e-4  # of each test, shared among its comparisons

seeds = st.integers(0, 2**64 - 1)


def ones_of(stream, tick, neurons):
    """Return the ones of eight bits from which all engines make the noise of a tick."""
    return noise.counts_at(noise.byte_counts(noise.words(stream, tick // 4, neurons)), tick)


def bound(comparisons):
    return norm.isf(ALPHA / 2 / comparisons)


def test_the_words_of_a_stream_never_change():
    stream = noise.stream_key(7, 3, "GPe")
    assert f"{stream:016x}" == "8e49deda421cf417"
    first = [f"{word:08x}" for word in noise.words(stream, 0, 4)]
    assert first == ["5d754225", "95e832e2", "88c6a1fa", "ee114694"]


def test_a_ticks_noise_is_exactly_the_binomial_of_eight_fair_bits():
    stream = noise.stream_key(1, 0, "STN/0")
    ones = np.array([ones_of(stream, tick, NEURONS) for tick in range(TICKS)])
    block = (ones - 4) / np.sqrt(2)
    expected = binom.pmf(np.arange(9), 8, 0.5) * block.size
    seen = np.bincount(ones.ravel().astype(int), minlength=9)
    assert chi2.sf(((seen - expected) ** 2 / expected).sum(), 8) > ALPHA
    # Mean, variance, and the fourth moment of that binomial: 3 - 2/8.
    for power, mean in ((1, 0), (2, 1), (4, 2.75)):
        values = block**power
        assert abs(values.mean() - mean) * np.sqrt(block.size) < bound(3) * values.std()


def test_bits32_has_the_moments_and_tails_of_its_binomial():
    draws = noise.bits32(noise.stream_key(1, 0, "STN/0"), noise.CELLS_TICK, 2**20)
    ones = np.rint(draws * np.sqrt(8) + 16).astype(int)
    expected = binom.pmf(np.arange(4, 29), 32, 0.5) * draws.size
    seen = np.bincount(np.clip(ones, 4, 28), minlength=29)[4:]
    assert chi2.sf(((seen - expected) ** 2 / expected).sum(), len(expected) - 1) > ALPHA
    assert abs(draws).max() <= 16 / np.sqrt(8)


def test_the_uniform_numbers_are_uniform():
    draws = noise.uniform(noise.stream_key(3, 0, "D1/0"), noise.START_TICK, 2**20)
    assert draws.min() >= 0
    assert draws.max() < 1
    assert abs(draws.mean() - 0.5) * np.sqrt(12 * draws.size) < bound(1)


def words_asked(monkeypatch, draw):
    """Return the stream and the tick of all words that a function draws."""
    asked, words = [], noise.words

    def recorded(stream, tick, neurons):
        asked.append((stream, tick))
        return words(stream, tick, neurons)

    with monkeypatch.context() as patch:
        patch.setattr(noise, "words", recorded)
        draw()
    return asked


def test_wires_constants_and_starts_are_drawn_from_words_of_their_own(monkeypatch):
    """No word serves two purposes, nor noise too, even where the seed is the wiring's."""
    circuit = anatomy.spiking_msprt().with_neurons(20).with_connections(0.25)
    wiring = wire(circuit)
    spiking = [b for b in range(wiring.blocks) if wiring.rows[b].spiking]

    def wires():
        for p in (p for p in circuit.projections if p.probability < 1):
            for target, source in np.ndindex(*map(circuit.channels_of, (p.target, p.source))):
                fan_in(circuit, p, target, source)

    def constants():
        for b in spiking:
            cell_factors(circuit, wiring.rows[b].name, int(wiring.channel[b]))

    def starts():
        for b in spiking:
            row = wiring.rows[b]
            if row.cell.renewal():
                continue
            stream = noise.stream_key(circuit.wiring_seed, 0, wiring.names[b])
            alike = row.cell.constants(np.ones((3, row.neurons)), 0.1)
            starting_state(row.cell, alike, stream, row.neurons)

    drawn = [words_asked(monkeypatch, draw) for draw in (wires, constants, starts)]
    assert all(len(asked) == len(set(asked)) > 3 for asked in drawn)
    # By their ticks, whatever the names: of one name, words would else be the same.
    ticks = [*({tick for _, tick in asked} for asked in drawn), {noise.TRAIN_TICK}]
    assert sum(map(len, ticks)) == len(set.union(*ticks)) == 6
    assert min(set.union(*ticks)) >= 2**62  # later than the noise of any trial


@given(seed=seeds, trial=seeds, tick=st.integers(0, 2**62), count=st.integers(1, 300))
def test_a_neurons_noise_does_not_depend_on_who_else_is_asked(seed, trial, tick, count):
    stream = noise.stream_key(seed, trial, "STN/0")
    every = noise.words(stream, tick, 300)
    assert np.array_equal(noise.words(stream, tick, count), every[:count])
    some = [count - 1, 0, 299]
    assert np.array_equal(noise.words(stream, tick, some), every[some])
    for draw in (ones_of, noise.bits32, noise.uniform):
        alone, all_ = draw(stream, tick, [count - 1])[0], draw(stream, tick, 300)
        assert alone == all_[count - 1]


def test_one_word_serves_four_ticks():
    stream = noise.stream_key(4, 0, "GPe/0")
    for tick in range(8):
        word = noise.words(stream, tick // 4, 1)[0]
        ones = ((int(word) >> 8 * (tick % 4)) & 255).bit_count()
        assert ones_of(stream, tick, 1)[0] == ones
