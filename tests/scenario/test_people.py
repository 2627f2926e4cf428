"""People of scenario files who walk, may do several things, or were recorded: what they become, how faults are said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import hpop
from hpop.cli.commands import main
from hpop.errors import HpopError, MapError, ScenarioError
from hpop.scenario import load_scenario
from hpop.world import Person, Track

HALL = """\
world:
  polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]], obstacles: [{corners: [[4, 4], [5, 4], [5, 6], [4, 6]]}]}
start: [1.0, 1.0, 0]
goal: [8.0, 1.0, any]
criteria: [turns, length, personal_space]
people:
"""
TRACKS = "# framerate: 10 fps\n# id frame x/cm y/cm\n3 0 100 300\n3 40 300 300\n4 20 800 100\n4 60 800 500\n"


@pytest.fixture
def made(tmp_path):
    """Write a scenario with entries of people, one a line."""
    (tmp_path / "tracks.txt").write_text(TRACKS)

    def make(*people: str, more: str = "") -> Path:
        path = tmp_path / "hall.yaml"
        path.write_text(HALL + "".join(f"  - {entry}\n" for entry in people) + more)
        return path

    return make


def people_of(path: Path) -> tuple[Person, ...]:
    return load_scenario(path).problem.world.content.people


def fault(path: Path, kind: type[HpopError]) -> str:
    with pytest.raises(HpopError) as error:
        load_scenario(path)
    assert type(error.value) is kind
    return str(error.value).removeprefix(f"{path}, ")


def test_waypoints_are_a_predicted_track(made):
    (eve,) = people_of(made("{waypoints: [[0, 1, 2], [4, 3, 2]], name: Eve, spread: 0.1, growth: 0.2, radius: 0.3}"))
    track = Track.through([(0, 1, 2), (4, 3, 2)])
    assert eve == Person.along(track, name="Eve", spread=0.1, growth=0.2, radius=0.3)


def test_futures_have_weights(made):
    future = "{weight: 1, waypoints: [[0, 1, 2], [3, 2, 2]], until: 2, afterwards: stays}"
    (one,) = people_of(
        made(f"{{x: 1, y: 2, futures: [{{weight: 3, velocity: [0.5, 0]}}, {future}]}}", more="horizon: 5")
    )
    first, second = one.futures
    assert (first.weight, first.velocity, first.until, first.afterwards) == (0.75, (0.5, 0.0), 5.0, "gone")
    track = Track.through([(0, 1, 2), (3, 2, 2)])
    assert (second.weight, second.track, second.until, second.afterwards) == (0.25, track, 2.0, "stays")


def test_the_people_of_a_file_are_those_who_are_there_from_now_on(made):
    three, four = people_of(made("{track: tracks.txt, radius: 0.2}"))
    assert (three.name, four.name, three.radius) == ("3", "4", 0.2)
    assert three.track == Track([0.0, 4.0], [1.0, 3.0], [3.0, 3.0], recorded=True)
    later, other = people_of(made("{track: tracks.txt, begin: 3, name: visitor}"))
    assert (later.name, later.x, later.settled) == ("visitor 3", 2.5, 1.0)
    assert (other.y, other.settled) == (2.0, 3.0)
    assert [p.name for p in people_of(made("{track: tracks.txt, begin: 4.5}"))] == ["4"]
    assert [p.name for p in people_of(made("{track: tracks.txt, until: 1.5}"))] == ["3"]
    (chosen,) = people_of(made("{track: tracks.txt, id: 4, name: Bo}"))
    assert chosen.name == "Bo"


def test_conversations_name_people_of_files(made):
    path = made("{x: 1, y: 5, name: Ada}", "{track: tracks.txt}", "{x: 2, y: 5}", more='groups: [[Ada, "4"], [0, 2]]')
    assert load_scenario(path).problem.world.content.groups == ((0, 2), (0, 3))
    text = fault(made("{x: 1, y: 5}", "{track: tracks.txt}", more="groups: [[0, 1]]"), ScenarioError)
    assert text == "line 9, groups.0.1: entry 1 is 2 people; give a name"


def test_a_scenario_with_tracks_survives_its_description(made):
    problem = load_scenario(made("{track: tracks.txt, begin: 1}", "{x: 1, y: 5, velocity: [1, 0]}", more="horizon: 8"))
    problem = problem.problem
    again = hpop.Problem.from_description(json.loads(json.dumps(problem.describe())))
    assert again.world.content.people == problem.world.content.people
    assert (again.horizon, again.notes) == (8.0, problem.notes)
    assert "to stop before it" in problem.notes[1]


@pytest.mark.parametrize(
    ("entry", "kind", "place", "says"),
    [
        ("{track: none.txt}", MapError, "people.0", "none.txt' cannot be opened"),
        ("{track: none.txt}", MapError, "people.0", "Paths are relative to the scenario's folder, /"),
        ("{track: tracks.txt, frame_rate: 25}", MapError, "people.0", "rate of 10 per second, but frame_rate is 25"),
        ("{track: tracks.txt, frame_rate: 0}", ScenarioError, "people.0.frame_rate", "greater than 0, got 0"),
        ("{track: tracks.txt, unit: km}", ScenarioError, "people.0.unit", "expected 'm', 'cm' or 'mm', got 'km'"),
        ("{track: tracks.txt, format: obsmat}", MapError, "people.0", "expected rows of 8 numbers"),
        ("{track: tracks.txt, id: 5}", MapError, "people.0", "has no id 5; it has 2 ids: 3, 4"),
        ("{track: tracks.txt, begin: 9}", MapError, "people.0", "no person of 'tracks.txt' is present from 9 s on"),
        ("{track: tracks.txt, until: 0}", MapError, "people.0", "is present from 0 s to 0 s: its"),
        ("{track: tracks.txt, id: []}", MapError, "people.0", "ids must be a list of numbers and names"),
        ("{trak: tracks.txt}", ScenarioError, "people.0.track", "this key is missing"),
        ("{wayponts: [[0, 1, 1], [2, 1, 2]]}", ScenarioError, "people.0.waypoints", "did you mean 'waypoints'?"),
        ("{track: tracks.txt, x: 1}", ScenarioError, "people.0.x", "no such key"),
        ("{track: 3}", ScenarioError, "people.0.track", "expected text, got 3"),
        ("{waypoints: [[0, 1, 1], [2, 1, 2], [1, 2, 2]]}", MapError, "people.0", "goes back: 2 s at point 1"),
        ("{waypoints: [[0, 1, 1], [0, 2, 2]]}", MapError, "people.0", "the same time twice"),
        ("{waypoints: [[0, 1, 1]]}", ScenarioError, "people.0.waypoints", "at least 2 entries, got 1"),
        ("{waypoints: [[0, 1], [1, 2]]}", ScenarioError, "people.0.waypoints.0", "a waypoint [t, x, y]"),
        ("{waypoints: [[0, 1, 1], [1, 90, 1]]}", MapError, "people.0", "89 m/s, faster than anybody runs"),
        ("{waypoints: [[0, 1, 1], [1, .nan, 1]]}", ScenarioError, "people.0.waypoints.1", "a waypoint [t, x, y]"),
        ("{x: 1, y: 1, until: -1}", ScenarioError, "people.0.until", "greater than or equal to 0, got -1"),
        ("{x: 1, y: 1, afterwards: flies}", ScenarioError, "people.0.afterwards", "'gone' or 'stays', got 'flies'"),
        ("{x: 1, y: 1, futures: [{velocity: [1, 0]}]}", ScenarioError, "people.0.futures.0", "key is missing"),
        ("{x: 1, y: 1, futures: [{weight: 0}]}", ScenarioError, "people.0.futures.0.weight", "greater than 0"),
        ("{x: 1, y: 1, velocity: [1, 0], futures: [{weight: 1}]}", MapError, "people.0", "leave the person's"),
        ("{x: 1, y: 1, growth: 0.1}", MapError, "people", "becomes ever more uncertain"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_people_is_said_at_their_place(made, entry, kind, place, says):
    path = made(entry)
    text = fault(path, kind)
    line = 6 if place == "people" else 7
    assert text.startswith(f"line {line}, {place}"), text
    assert says in text
    result = CliRunner().invoke(main, ["plan", str(path), "--out", str(path.parent / "out")])
    assert result.exit_code == kind.exit_code
    assert says in " ".join(result.output.split())


@pytest.mark.parametrize("horizon", ["0", "-1", "soon", ".inf"])
def test_a_horizon_is_a_time(made, horizon):
    assert fault(made("{x: 1, y: 1}", more=f"horizon: {horizon}"), ScenarioError).startswith("line 8, horizon: ")


def test_what_is_mended_in_a_file_of_tracks_is_noted(made, tmp_path):
    path = made("{track: tracks.txt}")
    (tmp_path / "tracks.txt").write_text(TRACKS + "9 5 0 0\n")
    (note,) = [note for note in load_scenario(path).problem.world.notes if "track file" in note]
    assert "has people at one time only, who are left out: 9" in note


def test_a_horizon_that_is_none_is_told_at_its_key(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(HALL.replace("people:\n", "horizon: 1.0e+9\n"))
    with pytest.raises(HpopError, match=r"line 6, horizon: .*must be a time in s from .*got 1000000000"):
        load_scenario(path)
