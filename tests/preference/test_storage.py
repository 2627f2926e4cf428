"""The file of a preference: what is written is read, on other fronts by units, and nothing else is taken."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.errors import StudyError
from hpop.frontier import ItemFront
from hpop.preference import Preference
from tests import preferring as people

CHOICES = [(3, 9), (8, 4), (1, 5), (2, 20), (40, 30)]


def saved(path: Path, **options: Any) -> Preference:
    person = Preference.fit(people.front(), CHOICES, **options)
    person.save(path)
    return person


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("people") / "p.json"
    saved(path)
    return json.loads(path.read_text())


def test_a_preference_is_read_as_it_was_written(tmp_path: Path) -> None:
    person = saved(tmp_path / "p07.json", question="comfort", features={"turns": 8.0, "length": "log"}, seed=3)
    again = Preference.load(tmp_path / "p07.json")
    assert again.weights == pytest.approx(person.weights, abs=0.02)
    assert (again.question, again.answers, again.seed, again.front) == ("comfort", person.answers, 3, person.front)
    assert again.best(people.front()).row == person.best().row
    assert again.random == pytest.approx(person.random, abs=0.01)
    assert (tmp_path / "p07.json").stat().st_size < 200_000


def test_asking_goes_on_where_it_ended(tmp_path: Path) -> None:
    person = saved(tmp_path / "p.json")
    again = Preference.load(tmp_path / "p.json").on(people.front())
    shown = [(a.first, a.second) for a in again.answers]
    assert sorted(shown) == sorted(CHOICES)
    more = people.asked(again, 8, 15 * np.array([0.1, 0.8, 0.1]), np.random.default_rng(1))
    assert more.answers[:5] == person.answers
    assert more.weights["turns"] == max(more.weights.values())
    pairs = [(a.first, a.second) for a in more.answers]
    assert len(set(pairs)) == len(pairs)


def test_without_a_front_it_says_what_to_do(tmp_path: Path) -> None:
    saved(tmp_path / "p.json")
    with pytest.raises(StudyError, match=re.escape("preference.on(front)")):
        Preference.load(tmp_path / "p.json").next_pair()


def test_on_another_front_a_metre_weighs_as_much() -> None:
    """Twice the range of length, as many turns: by units length decides twice as much, by the range it would not."""
    near: ItemFront[int] = ItemFront.of(
        [[10.0, 5.0], [20.0, 1.0]], names=["length", "turns"], units=["m", "1"], quanta=[1e-6, 1.0]
    )
    person = Preference.fit(near, [(0, 1)] * 6)
    share = person.weights["length"]
    a_metre, a_turn = share / 10.0, (1 - share) / 4.0
    far: ItemFront[int] = ItemFront.of(
        [[100.0, 50.0], [103.0, 40.0], [140.0, 30.0]], names=["length", "turns"], units=["m", "1"], quanta=[1e-6, 1.0]
    )
    costs = far.costs @ [a_metre, a_turn]
    assert person.best(far).row == far.select(preference=person).index == int(np.argmin(costs))


def test_a_front_that_lacks_a_cost_or_has_another_unit_is_refused_by_name() -> None:
    person = Preference.fit(people.front(), CHOICES)
    bare = people.front(k=2)
    with pytest.raises(StudyError, match="weighs 'exposure', which the front does not have"):
        bare.select(preference=person)
    other: ItemFront[int] = ItemFront.of(
        people.front().costs, names=["length", "turns", "exposure"], units=["mm", "1", "s"], quanta=[1e-6] * 3
    )
    with pytest.raises(StudyError, match="'length' in 'm', the front in 'mm'"):
        person.best(other)
    order: ItemFront[int] = ItemFront.of(
        people.front().costs[:, [2, 0, 1]],
        names=["exposure", "length", "turns"],
        units=["s", "m", "1"],
        quanta=[1e-6] * 3,
    )
    assert order[person.best(order).row].costs == person.best().point.costs  # the order of costs is of no matter


def changed(**changes: Any) -> Any:
    def apply(document: dict[str, Any]) -> None:
        for path, value in changes.items():
            *places, last = path.split("__")
            there: Any = document
            for place in places:
                there = there[int(place) if place.isdigit() else place]
            if value is DROPPED:
                del there[last]
            else:
                there[int(last) if last.isdigit() else last] = value

    return apply


DROPPED = object()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed(schema="hpop-front"), "not hpop-preference 1"),
        (changed(version=2), "of version 2"),
        (changed(extra=1), "unknown keys"),
        (changed(draws=DROPPED), "missing keys"),
        (changed(n=7), "5 answers, but n = 7"),
        (changed(seed=-1), "the seed -1"),
        (changed(criteria=[]), "0 criteria"),
        (changed(criteria__0__name="turns"), "a criterion twice"),
        (changed(criteria__0__range=-1.0), "in range, not from 0 to 1e+100"),
        (changed(criteria__0__unit=None), "'unit' to be of type str"),
        (changed(features={"turns": "cubic"}), "'log' or a number"),
        (changed(prior__spread=-1), "spread of the prior"),
        (changed(prior__about=[{"name": "length", "unit": "m", "size": 1.0}]), "0 concentrations for 1 costs"),
        (changed(answers__0__chosen=17), "an invalid answer"),
        (changed(answers__0__costs=[[1.0], [2.0]]), "expected 3 numbers"),
        (changed(answers__0__weight=1e9), "an invalid answer"),
        (changed(draws__sharpness=[1.0]), "expected 2000 numbers"),
        (changed(draws__shares__turns__0=-0.5), "in turns, not from 0 to 1"),
        (changed(draws__ties=[]), "0 draws"),
        (changed(draws__shares__turns__0=1e308), "in turns, not from 0 to 1"),
        (changed(draws__sharpness__0=1e308), "1e+308 in sharpness, not from 0 to 1e+50"),
        (changed(draws__ties__0=1e308), "1e+308 in ties, not from 1e-50 to 1e+50"),
        (changed(draws__ties__0=1e-308), "numbers from 1e-308 to"),
        (changed(criteria__0__range=1e-320), "a range below 1e-100"),
        (changed(criteria__0__ideal=-1e308), "numbers from -1e+308 to"),
        (changed(answers__0__costs=[[1e308, 0.0, 0.0], [2.0, 0.0, 0.0]]), "1e+308 in the costs of an answer"),
        (changed(prior__concentration=[1.0, 1.0]), "concentrations of 2 costs, but there are 3"),
        (changed(question="\x1b[2J"), "a question must be"),
        (changed(question=""), "a question must be"),
    ],
)  # fmt: skip
def test_what_is_no_preference_is_refused(tmp_path: Path, written: Any, change: Any, said: str) -> None:
    document = json.loads(json.dumps(written))
    change(document)
    (tmp_path / "bad.json").write_text(json.dumps(document))
    with pytest.raises(StudyError, match=re.escape(said)) as caught:
        Preference.load(tmp_path / "bad.json")
    assert "bad.json" in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"schema": NaN}', "[]", '{"a": 1, "a": 2}'])
def test_what_is_no_json_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(StudyError, match=r"p\.json: expected a preference"):
        Preference.load(tmp_path / "p.json")


def test_no_more_answers_are_taken_than_a_file_may_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hpop.preference.answers.MOST_ANSWERS", 5)
    person = saved(tmp_path / "p.json")
    with pytest.raises(StudyError, match="at most 5 answers of a person"):
        person.told(1, 2, 1)
    with pytest.raises(StudyError, match="at most 5 answers of a person"):
        Preference.fit(people.front(), [*CHOICES, (1, 2)])


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "p.json").open("wb") as file:
        file.truncate(20 * 1024**2)
    with pytest.raises(StudyError, match="at most 16777216 bytes"):
        Preference.load(tmp_path / "p.json")


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="create it"):
        Preference.fit(people.front()).save(tmp_path / "none" / "p.json")
