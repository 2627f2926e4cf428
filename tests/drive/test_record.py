"""Claims of the record of a drive: told again it is the same drive, also where a deadline cut a search short."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.errors import DriveError
from tests.drive.rooms import SOUTH, planned


def driven(seed: int) -> hpop.drive.Execution:
    """Return a drive with events of every sort."""
    rng = np.random.default_rng(seed)
    problem, front = planned()
    drive = hpop.follow(problem, front, int(rng.integers(len(front))), begin=2.0)
    drive.at(3.0, (1.1, 2.02, 0.1))
    drive.options(3.0, 0.0)
    drive.world(3.2, close=SOUTH, name="the south door")
    options = drive.options(3.4, [0.0, 1e-3, 1.0][seed % 3])
    if len(options):
        drive.take(options.knee())
    drive.world(6.0, open="the south door")
    drive.adapt(drive.options(6.5))
    options = drive.options(7.0)
    if options.keep_on is not None:
        drive.wish("fewer turns")
    drive.take(int(rng.integers(len(options))))
    return drive


def costs(options: hpop.drive.Options) -> list[Any]:
    return [option.costs | {"leaves": option.leaves_at, "turn": option.next_turn} for option in options]


@pytest.mark.seeds(1, of=30)
def test_a_drive_that_is_told_again_is_the_same(seed: int, tmp_path: Path) -> None:
    drive = driven(seed)
    drive.save(tmp_path / "drive.json")
    again = hpop.drive.load(tmp_path / "drive.json")
    assert again.plan.kinds == drive.plan.kinds
    for name in drive.plan.states.names:
        assert np.array_equal(getattr(again.plan.states, name), getattr(drive.plan.states, name))
    assert again.record == json.loads(json.dumps(drive.record))
    now = drive.record[-1]["now"] + 0.5
    assert again.at(now).past == drive.at(now).past
    assert costs(again.options(now)) == costs(drive.options(now))
    again.save(tmp_path / "again.json")
    drive.save(tmp_path / "drive.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "drive.json").read_bytes()


def test_until_the_graph_is_built_options_are_the_known_plans_and_are_told_again_the_same(tmp_path: Path) -> None:
    problem, front = planned()
    drive = hpop.follow(problem, front, 0, waits=False)
    known = drive.options(0.0, 1.0, within=0.0)
    assert known.status is hpop.Status.TIME_LIMIT
    assert known.gap == np.inf
    assert known.keep_on is not None
    exact = drive.options(0.0, 1.0)
    assert exact.status is hpop.Status.COMPLETE
    assert known.commit.time == exact.commit.time
    of_exact = np.array([list(option.costs.values()) for option in exact])
    for option in known:
        values = np.array(list(option.costs.values()))
        assert option.keeps_on or (np.abs(of_exact - values).max(axis=1) < 1e-9).any()
    drive.take(int(exact.place_of(0)))
    drive.save(tmp_path / "drive.json")
    again = hpop.drive.load(tmp_path / "drive.json")
    assert again.record == json.loads(json.dumps(drive.record))
    assert again.plan.kinds == drive.plan.kinds


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """Return the document of a drive that has just begun."""
    problem, front = planned()
    path = tmp_path_factory.mktemp("drives") / "drive.json"
    hpop.follow(problem, front, "knee").save(path)
    document: dict[str, object] = json.loads(path.read_text())
    return document


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("schema", "hpop-front", "expected a drive"),
        ("version", 2, "expected version 1"),
        ("ways", {"kinds": []}, "drive.json"),
        ("planner", {"latice": {}}, "unknown planner"),
        ("begin", None, "begin must be"),
        ("events", [{"event": "jump", "now": 0}], "unknown event 'jump'"),
        ("events", [{"event": "open", "now": 1.0, "area": "a door", "name": ""}], "'a door'"),
        ("events", [{"event": "close", "now": 1.0, "area": {"type": "Polygon"}, "name": ""}], "drive.json"),
        (
            "events",
            [
                {
                    "event": "close",
                    "now": 1,
                    "area": {"type": "Polygon", "coordinates": [[[10**400, 0]] * 4]},
                    "name": "",
                }
            ],
            "drive.json: expected the record of a drive",
        ),
        ("events", [{"event": "seen", "now": 1e300, "state": [1, 1, 0]}], "now must be"),
        ("events", [{"event": "take", "now": 1, "place": 10**9, "stands": 0, "rest": None}], "drive.json"),
        ("events", 5, "drive.json"),
    ],
)
def test_a_file_that_is_none_of_a_drive_is_refused_by_its_name(
    key: str, value: object, said: str, stored: dict[str, object], tmp_path: Path
) -> None:
    (tmp_path / "drive.json").write_text(json.dumps(stored | {key: value}))
    with pytest.raises(DriveError, match=said):
        hpop.drive.load(tmp_path / "drive.json")
