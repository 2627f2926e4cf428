"""Events files: what stands in them is what happens, and what is wrong is told by line, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely

import hpop
from hpop.errors import HpopError
from hpop.scenario.events import load_events
from hpop.world import Person, World
from hpop.world.content.content import Zone

GOOD = """\
choice: least turns
events:
  - {at: 1, close: east door}
  - {at: 2, close: [[3, 2], [4, 2], [4, 3]], name: wet floor}
  - {at: 2, stop: Ada}
  - {at: 3, people: [{x: 8, y: 5, velocity: [-0.8, 0]}, {waypoints: [[0, 2, 7], [5, 6, 7]]}]}
  - {at: 4.5, wish: {duration: -0.2}}
  - {at: 5, wish: hurry}
  - {at: 6, take: 3}
  - {at: 7, open: wet floor}
  - {at: 8, options: true}
"""


def read(folder: Path, text: str):
    (folder / "events.yaml").write_text(text)
    return load_events(folder / "events.yaml")


def test_each_entry_is_the_event_that_it_says(tmp_path: Path) -> None:
    script = read(tmp_path, GOOD)
    assert script.choice == "least turns"
    kinds = ["close", "close", "stop", "people", "wish", "wish", "take", "open", "options"]
    assert [event.kind for event in script.events] == kinds
    assert [event.at for event in script.events] == [1, 2, 2, 3, 4.5, 5, 6, 7, 8]
    door, floor, ada, people, share, hurry, third, opened, looked = script.events
    assert (door.value, ada.value, hurry.value, third.value, opened.value) == (
        "east door",
        "Ada",
        "hurry",
        3,
        "wet floor",
    )
    assert floor.value.equals(shapely.Polygon([(3, 2), (4, 2), (4, 3)]))
    assert floor.name == "wet floor"
    assert [(p.x, p.y, p.moves) for p in people.value] == [(8, 5, True), (2, 7, True)]
    assert share.value == {"duration": -0.2}
    assert looked.value is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("at: 8", "at: 1", "line 11.*comes before the event above"),
        ("at: 1,", "at: -1,", "line 3.*at"),
        ("{at: 1, close", "{close", "line 3.*at"),
        ("close: east door", "closed: east door", "line 3.*closed"),
        ("stop: Ada", "stop: Ada, wish: hurry", "line 5.*exactly one of.*stop and wish"),
        ("stop: Ada", "name: Ada", "line 5.*exactly one of"),
        ("[4, 2], [4, 3]]", "[4, 2]]", "line 4.*three or more corners"),
        ("velocity: [-0.8, 0]", "velocity: fast", "line 6.*velocity"),
        ("options: true", "options: true, name: x", "line 11.*only an area given by corners"),
        ("choice: least turns", "chioce: knee", "chioce"),
        ("events:", "events: []\nothers:", "events: expected at least 1 entry, got 0"),
        ("options: true", "options: false", "line 11.*options: expected True, got False"),
    ],
)
def test_what_is_wrong_is_told_by_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    with pytest.raises(HpopError, match=f"(?s){words}"):
        read(tmp_path, GOOD.replace(old, new))


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(HpopError, match=r"(?s)line 3.*line 5"):
        read(tmp_path, GOOD.replace("at: 1,", "at: soon,").replace("stop: Ada", "stop: [Ada]"))


DOORS = [Zone("keep-out", shapely.box(9, 4, 9.5, 6), name="east door"), Zone("speed", shapely.box(1, 1, 2, 2), limit=1)]
HALL = World.from_polygons([], extent=shapely.box(0, 0, 12, 8)).with_content(
    people=[Person(6, 4, name="Ada"), Person(7, 4, name="Ben", velocity=(0.1, 0), until=5)], zones=DOORS
)
ASKED = hpop.Problem(HALL, hpop.DifferentialDrive(radius=0.3), (1, 4, 0), (8, 4, 0), ["turns", "duration"])
PLAIN = """\
events:
  - {at: 1, open: east door}
  - {at: 2, stop: Ben}
  - {at: 3, people: [{name: Cleo, x: 5, y: 7}]}
  - {at: 4, close: [[3, 2], [4, 2], [4, 3]], name: wet floor}
  - {at: 5, stop: Cleo}
  - {at: 6, open: wet floor}
  - {at: 7, wish: {duration: -0.2}}
  - {at: 8, wish: hurry}
  - {at: 9, take: least turns}
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("open: east door", "close: east door", "line 2.*'east door' is closed already"),
        ("open: east door", "open: west door", "line 2.*no door.*'west door'.*Did you mean 'east door'"),
        ("open: wet floor", "open: east door", "line 7.*'east door' is not closed"),
        ("stop: Ben", "stop: Bne", "line 3.*expected the name of one person, got 'Bne'.*Did you mean 'Ben'"),
        ("stop: Ben", "stop: 2", "line 3.*expected the name of one person, got 2"),
        ("stop: Cleo", "stop: Ada", "line 6.*expected the name of one person, got 'Ada'"),
        ("wish: {duration", "wish: {turn", "line 8.*no cost 'turn' to wish for.*Did you mean 'turns'"),
        ("wish: hurry", "wish: fewer tunrs", "line 9.*no cost 'tunrs'.*Did you mean 'turns'"),
        ("wish: hurry", "wish: slower", "line 9.*a wish must be 'hurry'"),
        ("take: least turns", "take: least tunrs", "line 10.*least tunrs.*Did you mean 'least turns'"),
        ("[4, 2], [4, 3]]", "[4, 2], [3, 2]]", "line 5"),
        ("[[3, 2], [4, 2], [4, 3]]", "[[3, 20], [4, 20], [4, 21]]", "line 5.*'wet floor' is not on the map.*12, 8"),
    ],
)
def test_what_a_drive_does_not_know_is_told_by_line_before_it_begins(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    (tmp_path / "events.yaml").write_text(PLAIN)
    names = ("turns", "duration")
    assert len(load_events(tmp_path / "events.yaml", ASKED, names).events) == 9
    assert old in PLAIN
    (tmp_path / "events.yaml").write_text(PLAIN.replace(old, new))
    with pytest.raises(HpopError, match=f"(?s){words}"):
        load_events(tmp_path / "events.yaml", ASKED, names)


def test_who_wishes_to_hurry_is_told_by_line_where_the_duration_is_no_cost(tmp_path: Path) -> None:
    (tmp_path / "events.yaml").write_text(PLAIN.replace("duration: -0.2", "turns: -0.2"))
    with pytest.raises(
        HpopError, match=r"(?s)line 9.*'hurry' needs the cost duration, but the front has turns, length"
    ):
        load_events(tmp_path / "events.yaml", ASKED, ("turns", "length"))


def test_all_that_a_drive_does_not_know_is_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "events.yaml").write_text(PLAIN.replace("east door", "west door").replace("stop: Ben", "stop: Bo"))
    with pytest.raises(HpopError, match=r"(?s)line 2.*line 3"):
        load_events(tmp_path / "events.yaml", ASKED, ("turns", "duration"))


@pytest.mark.parametrize("text", ["", "[1, 2]", "events: 3", "a: &a [*a]"])
def test_what_is_no_events_file_is_an_error_of_the_user(tmp_path: Path, text: str) -> None:
    with pytest.raises(HpopError):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(HpopError, match=r"nowhere\.yaml"):
        load_events(tmp_path / "nowhere.yaml")
