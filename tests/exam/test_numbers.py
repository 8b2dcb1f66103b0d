"""The list of the exam: what is refused, and numbers computed again from shipped data."""

import dataclasses

import numpy as np
import pytest

from bgmodel.exam.exam import Exam
from bgmodel.exam.numbers import Number, read_numbers
from bgmodel.trials.files import shipped
from circuits.errors import InputError
from tests.helpers import refused, refusing

GIVEN = {
    "id": "mine", "about": "a rate", "measure": "rate", "unit": "Hz", "species": "rat",
    "of": {"nucleus": "STN", "window": "rest", "task": "rest"}, "source": "nobody",
    "mark": "read", "how": "a test",
}  # fmt: skip
TASKS = Exam.shipped().tasks
OFF_MS = 300.0
"""Time outside the decision that the list assumes."""


def by_id():
    return {one.id: one for one in Exam.shipped().numbers}


def test_the_hash_follows_every_number():
    first = Exam.shipped()
    changed = dataclasses.replace(first.numbers[0], weight=0.3)
    other = dataclasses.replace(first, numbers=(changed, *first.numbers[1:]))
    assert Exam.shipped().sha256 == first.sha256 != other.sha256


test_a_number_is_a_value_with_its_error_or_a_direction = refusing(
    ({"value": 3.0}, "value"),
    ({"low": 2.0, "high": 2.0}, "value"),
    ({"direction": "up", "mark": "memory"}, "mark"),
    ({"direction": "up", "weight": 0.0}, "weight"),
    of=lambda changes: Number(**GIVEN | changes),
)


def test_a_file_adds_numbers_and_marks_the_version(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        'domain = "mine"\n[[numbers]]\nid = "a.rate"\nabout = "a"\nmeasure = "rate"\n'
        'of = { nucleus = "STN", window = "rest", task = "rest" }\nunit = "Hz"\nvalue = 20\n'
        'se = 1\nspecies = "rat"\nsource = "me"\nmark = "read"\nhow = "b"\n'
    )
    exam = Exam.shipped().with_numbers(file)
    assert exam.version == f"{Exam.shipped().version}+"
    assert exam.domains[-1] == "mine"
    with refused("id"):
        exam.with_numbers(file)
    file.write_text(file.read_text().replace('"rest" }', '"nap" }'))
    with refused("task"):
        Exam.shipped().with_numbers(file)
    file.write_text(file.read_text().replace('"nap" }', '"rest" }').replace('"rate"', '"mood"'))
    with refused("measure"):
        Exam.shipped().with_numbers(file)
    file.write_text("domain = 1")
    with pytest.raises(InputError):
        read_numbers(file)


CHANGE = {"task": "reference", "minus_task": "stimulation"}
test_a_number_that_its_measure_could_not_answer_is_refused = refusing(
    ({"unit": "kHz"}, "unit"),
    ({"of": {"nucleus": "STN", "window": "rest", "task": "rest", "rolle": "all"}}, "of"),
    ({"of": {"nucleus": "STN", "task": "rest"}}, "of"),
    ({"measure": "rate_change"}, "of"),
    ({"measure": "time_change", "unit": "s", "of": CHANGE}, "unit"),
    ({"measure": "time_change", "unit": "%", "of": CHANGE}, "unit"),
    ({"measure": "time_change", "unit": "%", "of": CHANGE | {"unit": "%"}}, "of"),
    ({"measure": "time_change", "unit": "ms", "of": CHANGE | {"unit": "percent"}}, "unit"),
    ({"measure": "time_change", "unit": "ms", "of": CHANGE | {"minus_task": "reference"}}, "of"),
    ({"measure": "accuracy_change", "unit": "%", "of": CHANGE}, "unit"),
    ({"measure": "accuracy_change", "unit": "proportion", "of": CHANGE}, "value"),
    of=lambda wrong: Exam("", (Number(**GIVEN | {"value": 3.0, "se": 1.0} | wrong),), TASKS),
)


def test_an_exam_of_unknown_numbers_is_refused():
    with refused("id must be those of numbers"):
        Exam.shipped().of(["rest.stn", "rest.sn"])


def test_patients_under_conflict_have_the_numbers_of_the_list():
    table = shipped()["cavanagh_2011"].table
    by = ["participant_id", "conflict", "stimulation"]
    means = table.groupby(by)[["rt", "response"]].mean().unstack(["conflict", "stimulation"])
    rt, right = 1000 * means["rt"], means["response"]
    base = rt["low"]["off"].mean() - OFF_MS
    changes = {
        "conflict.cost": (rt["high"]["off"] - rt["low"]["off"]) / base,
        "dbs.none": (rt["low"]["on"] - rt["low"]["off"]) / base,
        "dbs.conflict": (rt["high"]["on"] - rt["high"]["off"])
        / (rt["high"]["off"].mean() - OFF_MS),
        "dbs.interaction": (
            rt["high"]["on"] - rt["high"]["off"] - rt["low"]["on"] + rt["low"]["off"]
        )
        / base,
    }
    for name, each in changes.items():
        number = by_id()[name]
        assert 100 * each.mean() == pytest.approx(number.middle, abs=0.06)
        assert 100 * each.sem() == pytest.approx(number.error(0), abs=0.06)
    change = right["low"]["on"] - right["low"]["off"]
    number = by_id()["dbs.accuracy.none"]
    known = number.middle, number.error(0)
    assert (change.mean(), change.sem()) == pytest.approx(known, abs=6e-4)


def skew(times):
    low, middle, high = np.quantile(times, (0.1, 0.5, 0.9))
    return (high - middle) / (middle - low)


def test_monkeys_and_people_without_evidence_have_the_skewness_of_the_list():
    monkeys = shipped()["roitman_shadlen_2002"].table
    still = monkeys[monkeys["coherence"] == 0].groupby("participant_id")["rt"]
    for name, times in still:
        assert skew(times) == pytest.approx(by_id()[f"times.skew.{name}"].middle, abs=0.006)
    people = shipped()["palmer_huk_shadlen_2005"].table
    each = people[people["coherence"] == 0].groupby("participant_id")["rt"].agg(skew)
    number = by_id()["times.skew.people"]
    assert (each.mean(), each.sem()) == pytest.approx((number.middle, number.error(0)), abs=0.002)


def test_errors_of_monkeys_have_the_delay_of_the_list():
    monkeys = shipped()["roitman_shadlen_2002"].table
    faint = monkeys[np.isclose(monkeys["coherence"].abs(), 0.064)]
    for name, part in faint.groupby("participant_id"):
        right = part["correct"] == 1
        wrong, fine, sd = part["rt"][~right], part["rt"][right], part["rt"].std()
        number = by_id()[f"times.errors.{name}"]
        assert (wrong.mean() - fine.mean()) / sd == pytest.approx(number.middle, abs=0.001)
        se = np.sqrt(wrong.var() / len(wrong) + fine.var() / len(fine)) / sd
        assert se == pytest.approx(number.error(0), abs=0.001)
