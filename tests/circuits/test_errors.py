"""Errors that name an argument, and families of warnings."""

import pickle
import warnings
from contextvars import Context

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st

from circuits import errors


@pytest.mark.parametrize(
    ("value", "start"),
    [
        (1, "1"),
        (0.1 + 0.2, "0.3"),
        (np.float32(0.5), "0.5"),
        ("left", "'left'"),
        (np.array([1, 2]), "[1, 2]"),
        (np.zeros((30, 2)), "an array of float64, shape (30, 2)"),
        (np.dtype("int8"), "int8"),
        (int, "int"),
        ("a\nb " * 50, "'a\\nb a\\nb"),
    ],
)
def test_a_value_is_shown_in_one_short_line(value, start):
    assert errors.shown(value).startswith(start)
    assert len(errors.shown(value)) <= errors.LONGEST
    assert len(errors.shown(value).splitlines()) == 1


def test_an_error_is_a_sentence_with_a_field_and_what_was_given():
    error = errors.InputError.of("tau_ms", "must be >= 0", -1.0, owner="STN")
    assert (str(error), error.field, error.given) == (
        "STN: tau_ms must be >= 0, got -1", "tau_ms", -1.0,
    )  # fmt: skip
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("value", [2, "x", None, lambda: 3])
def test_an_error_comes_back_from_another_process(value):
    error = errors.InputError("a sentence", "channels", value)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.field) == (errors.InputError, "a sentence", "channels")
    assert again.given == (errors.shown(value) if callable(value) else value)


def test_what_an_error_is_about_is_named_first():
    error = errors.within("a.csv", errors.InputError("rt must be > 0", "rt", -1), "path")
    assert (str(error), error.field, error.given) == ("a.csv: rt must be > 0", "rt", -1)
    other = errors.within("", TypeError("wrong"), "path")
    assert (str(other), other.field, other.given) == ("wrong", "path", None)


def test_every_family_of_warnings_is_silenced_as_one():
    families = [kind for name, kind in vars(errors).items() if name.endswith("Warning")]
    assert len(families) == 10
    assert all(issubclass(kind, errors.BgmodelWarning) for kind in families)
    assert issubclass(errors.BgmodelWarning, UserWarning)


KINDS = errors.DataWarning, errors.RangeWarning
STEP = st.tuples(
    st.integers(0, 2),
    st.one_of(
        st.sampled_from(["leave", "raise"]),
        st.sampled_from([(), (errors.DataWarning,), (errors.RangeWarning,), KINDS]),
        st.sampled_from(KINDS),
    ),
)
"""A step of one of three threads: it warns, or enters or leaves a block that collects warnings."""


@drawn(st.lists(STEP, max_size=40))
def test_a_warning_goes_to_the_innermost_block_of_its_own_thread_in_any_order(steps):
    contexts, entered, issued = [Context() for _ in range(3)], ([], [], []), []
    with warnings.catch_warnings(record=True) as of_process:
        warnings.simplefilter("always")
        before = list(warnings.filters), warnings.showwarning
        for number, (who, what) in enumerate(steps):
            context, blocks = contexts[who], entered[who]
            if isinstance(what, tuple):
                block = errors.collected(*what)
                blocks.append((what or KINDS, block, context.run(block.__enter__), []))
            elif isinstance(what, str) and blocks:
                error = ValueError("of the block") if what == "raise" else None
                context.run(leave, blocks.pop()[1], error)
            elif isinstance(what, type):
                context.run(what.warn, f"{number}")
                takers = [wanted for kinds, _, _, wanted in reversed(blocks) if what in kinds]
                (takers[0] if takers else issued).append(f"{number}")
            for one in entered:
                assert all(kept == wanted for _, _, kept, wanted in one)
        assert (list(warnings.filters), warnings.showwarning) == before
    assert [str(one.message) for one in of_process] == issued
    for context, blocks in zip(contexts, entered, strict=True):
        for _, block, *_ in reversed(blocks):
            context.run(leave, block, None)


def leave(block, error):
    """Leave a block, by an error or at its end; an error is not kept back."""
    assert not block.__exit__(type(error) if error else None, error, None)


def test_silence_is_for_some_categories_or_all():
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        with errors.quiet(errors.RangeWarning):
            errors.RangeWarning.warn("silenced")
            errors.DataWarning.warn("issued")
            with errors.quiet():
                errors.BgmodelWarning.warn("silenced")
        errors.RangeWarning.warn("issued after the block")
    assert [str(one.message) for one in issued] == ["issued", "issued after the block"]
