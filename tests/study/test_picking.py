"""Claims: the rows that are picked differ most, in costs or ways, and last alike where that is asked for."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import hpop
from hpop.base.arrays import FloatArray
from hpop.errors import OptionError, StudyError, UnknownName
from hpop.study.conditions import pick
from hpop.trajectories.trajectory import Trajectory


def places(trajectory: Trajectory, count: int = 40) -> FloatArray:
    """Places (count, 2) at equal shares of a way of straight moves and turns in place, by walking its corners."""
    corners = np.stack([trajectory.states.x, trajectory.states.y], axis=1)
    legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    found = []
    for share in np.linspace(0, 1, count):
        rest = share * legs.sum()
        for i, leg in enumerate(legs):
            if rest <= leg + 1e-9 and leg > 0:
                found.append(corners[i] + rest / leg * (corners[i + 1] - corners[i]))
                break
            rest -= leg
    return np.array(found)


def test_rows_by_paths_are_the_farthest_apart(front: hpop.Front) -> None:
    """The second is the row whose way is farthest from the first's, found by walking the corners of both."""
    first, second = (row.number for row in pick(front, 2, always=("knee",), by="paths"))
    ways = [places(trajectory) for trajectory in front.trajectories]
    apart = [float(np.linalg.norm(way - ways[first], axis=1).mean()) for way in ways]
    assert apart[second] == pytest.approx(max(apart), rel=0.01)
    assert first == front.knee().index


def test_named_rows_come_first_and_all_differ(front: hpop.Front) -> None:
    rows = pick(front, 4, always=("least length", "knee"))
    assert [row.name for row in rows][:2] == ["least length", "knee"]
    assert len({row.number for row in rows}) == 4


@pytest.mark.parametrize("share", [0.02, 0.06, 0.2])
@pytest.mark.parametrize("by", ["costs", "paths"])
def test_rows_last_alike_where_that_is_asked_for(front: hpop.Front, share: float, by: str) -> None:
    """As many rows as can be had, by trying all sets of rows."""
    lasts = [trajectory.execution().duration for trajectory in front.trajectories]
    several = [
        rows
        for size in range(1, 7)
        for rows in combinations(range(len(front)), size)
        if max(lasts[i] for i in rows) <= (1 + share) * min(lasts[i] for i in rows)
    ]
    most = max(map(len, several))
    chosen = [lasts[row.number] for row in pick(front, most, always=(), by=by, share=share)]
    assert max(chosen) <= (1 + share) * min(chosen) * (1 + 1e-9)
    if most < len(front):
        with pytest.raises(StudyError, match=f"count is {most + 1}, but the front has {most}"):
            pick(front, most + 1, always=(), by=by, share=share)


def test_rows_asked_for_that_do_not_last_alike_are_refused(front: hpop.Front) -> None:
    with pytest.raises(StudyError, match=r"last 14\.6 to 17\.0 s when executed.* a share of 0\.16"):
        pick(front, 3, always=(0, 2), share=0.1)
    assert len(pick(front, 3, always=(0, 2), share=0.17)) == 3


@pytest.mark.parametrize(
    ("given", "kind", "match"),
    [
        ({"count": 0}, StudyError, "count must be"),
        ({"count": 27}, StudyError, "from 1 to 26"),
        ({"count": 7}, StudyError, "the front has 6"),
        ({"count": 2, "by": "path"}, StudyError, "Did you mean 'paths'"),
        ({"count": 1, "always": (0, 1)}, StudyError, "always names 2"),
        ({"count": 2, "always": ("lest turns",)}, UnknownName, "Did you mean 'least turns'"),
        ({"count": 2, "always": (6,)}, OptionError, "no row 6"),
        ({"count": 2, "share": -0.1}, StudyError, "share must be"),
    ],
)
def test_what_cannot_be_picked_is_told(front: hpop.Front, given: dict[str, object], kind: type, match: str) -> None:
    with pytest.raises(kind, match=match):
        pick(front, **given)  # type: ignore[arg-type]
