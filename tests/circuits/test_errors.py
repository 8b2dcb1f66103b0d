"""Errors that name an argument, and families of warnings."""

import pickle

import numpy as np
import pytest

from circuits import errors
from circuits.errors import InputError, shown, within


@pytest.mark.parametrize(
    ("given", "said"),
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
def test_a_value_is_shown_in_one_short_line(given, said):
    assert shown(given).startswith(said)
    assert len(shown(given)) <= errors.LONGEST
    assert len(shown(given).splitlines()) == 1


def test_an_error_is_a_sentence_with_a_field_and_what_was_given():
    error = InputError.of("tau_ms", "must be >= 0", -1.0, owner="STN")
    assert (str(error), error.field, error.given) == (
        "STN: tau_ms must be >= 0, got -1", "tau_ms", -1.0,
    )  # fmt: skip
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("given", [2, "x", None, lambda: 3])
def test_an_error_comes_back_from_another_process(given):
    error = InputError("a sentence", "channels", given)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.field) == (InputError, "a sentence", "channels")
    assert again.given == (shown(given) if callable(given) else given)


def test_what_an_error_is_about_is_named_first():
    error = within("a.csv", InputError("rt must be > 0", "rt", -1), "path")
    assert (str(error), error.field, error.given) == ("a.csv: rt must be > 0", "rt", -1)
    other = within("", TypeError("wrong"), "path")
    assert (str(other), other.field, other.given) == ("wrong", "path", None)


def test_every_family_of_warnings_is_silenced_as_one():
    families = [kind for name, kind in vars(errors).items() if name.endswith("Warning")]
    assert len(families) == 9
    assert all(issubclass(kind, errors.BgmodelWarning) for kind in families)
    assert issubclass(errors.BgmodelWarning, UserWarning)
