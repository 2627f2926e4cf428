"""Cards: the few ways of a front that a viewer is shown, their words, and the way that lies nearest to a push."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.base.text import printable
from hpop.drive.options import perceived_motions
from hpop.drive.plan import part
from hpop.frontier.choices import Preferring
from hpop.problems.front import Front
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

AHEAD = 3.0
"""Time, s, from the beginning of a way on, in which its heading is compared with a push."""
SAMPLED = 0.1
"""Time between the compared headings, s."""
FOLLOWED = math.radians(30.0)
"""Largest mean angle, rad, between a push and the present plan at which the plan counts as following the push."""
ALIKE = 0.05
"""Share up to which two costs count as equal in words."""
COMPARED = 25
"""Points of each way, evenly along its path, by which ways are compared."""
PLAIN = ("duration", "length", "turns")
"""Costs that the words of a card tell anyway."""
MOST_PHRASES = 2


@dataclass(frozen=True, eq=False)
class Ways:
    """Trajectories to choose from: the points of a front, and as the last one the present plan if it is dominated.

    trajectories  (n,)
    costs         (n, k)  as re-evaluated for the front
    front         front of the trajectories, with names, units and groups of the costs
    present       index of the rest of the present plan among the trajectories; None if it is none of them
    """

    trajectories: tuple[Trajectory, ...]
    costs: FloatArray
    front: Front
    present: int | None = None

    @cached_property
    def table(self) -> MotionTable:
        """The distinct motions of the trajectories."""
        return MotionTable.of(self.trajectories)

    @cached_property
    def motions(self) -> tuple[tuple[int, ...], ...]:
        """Motions of each trajectory, as indices into the table."""
        ends = np.cumsum(self.table.counts)
        return tuple(tuple(each.tolist()) for each in np.split(self.table.motions, ends[:-1]))

    @property
    def durations(self) -> FloatArray:
        """Planned durations (n,), s."""
        return self.table.durations


def line_of(trajectory: Trajectory) -> list[list[float]]:
    """Return the corners (x, y), m, of a trajectory's path; points on straight stretches between them are left out."""
    points = np.stack([trajectory.states.x, trajectory.states.y], axis=1)
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-6)]
    if len(points) > 2:
        steps = np.diff(points, axis=0)
        turned = wrap(np.diff(np.arctan2(steps[:, 1], steps[:, 0])))
        points = points[np.concatenate([[True], np.abs(turned) > 1e-6, [True]])]
    corners: list[list[float]] = np.round(points, 3).tolist()
    return corners


def turns_of(trajectory: Trajectory) -> int:
    """Return the number of turns that a person aboard perceives."""
    return sum(motion.kind.startswith("turn") for motion in perceived_motions(trajectory))


def described(ways: Ways) -> list[dict[str, Any]]:
    """Return all ways as JSON: number, costs by name, and line."""
    names = ways.front.names
    return [
        {"option": i, "costs": dict(zip(names, row, strict=True)), "line": line_of(trajectory)}
        for i, (row, trajectory) in enumerate(zip(ways.costs.tolist(), ways.trajectories, strict=True))
    ]


def cards(ways: Ways, preference: Preferring | None = None) -> list[dict[str, Any]]:
    """Return up to five ways as JSON, each with a name and words: "knee", "gentlest", "quickest", and so on.

    A way that has several of these names is returned once, with the first.
    """
    if not ways.trajectories:
        return []
    quickest = int(np.argmin(ways.durations))
    chosen: dict[int, str] = {}

    def choose(row: int, name: str) -> None:
        chosen.setdefault(row, name)

    if len(ways.front):
        choose(ways.front.knee().index, "knee")
    choose(gentlest(ways), "gentlest")
    choose(quickest, "quickest")
    if preference is not None and len(ways.front):
        choose(ways.front.select(preference=preference).index, "for you")
    if (other := most_different(ways, list(chosen))) is not None:
        choose(other, "most different")
    rows = described(ways)
    return [{**rows[row], "name": name, "words": words(ways, row, quickest)} for row, name in chosen.items()]


def gentlest(ways: Ways) -> int:
    """Return the index of the way with the least comfort costs, each as a share of its range over the ways.

    If no cost is of the group C (comfort), it is the way with the fewest turns. Of several, the quickest is returned.
    """
    comfort = [j for j, group in enumerate(ways.front.groups) if group == "C"]
    if comfort:
        costs = ways.costs[:, comfort]
        span = np.ptp(costs, axis=0)
        shares = np.divide(costs - costs.min(axis=0), span, out=np.zeros(costs.shape), where=span > 0).sum(axis=1)
    else:
        shares = np.array([turns_of(trajectory) for trajectory in ways.trajectories], float)
    return int(np.lexsort((ways.durations, np.round(shares, 9)))[0])


def most_different(ways: Ways, shown: Sequence[int]) -> int | None:
    """Return the index of the way whose path is farthest from the nearest of the ``shown`` ways; None if all are shown.

    The distance of two paths is the mean distance of their points at equal shares of their lengths.
    """
    if len(shown) == len(ways.trajectories):
        return None
    points = np.stack([_evenly(trajectory) for trajectory in ways.trajectories])  # (n, COMPARED, 2)
    apart = np.stack([np.hypot(*(points - points[row]).transpose(2, 0, 1)).mean(axis=1) for row in shown]).min(axis=0)
    apart[list(shown)] = -1.0
    return int(np.argmax(apart))


def _evenly(trajectory: Trajectory) -> FloatArray:
    """Return points (COMPARED, 2), m, at equal distances along a path, from its first to its last point."""
    x, y = trajectory.states.x, trajectory.states.y
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    at = np.linspace(0.0, along[-1], COMPARED)
    return np.stack([np.interp(at, along, x), np.interp(at, along, y)], axis=1)


def words(ways: Ways, row: int, quickest: int) -> str:
    """Return a way in words, relative to the quickest: "1.2 times as long, no turns", where "long" is its duration.

    row, quickest  indices of the way and of the quickest way, whose words are "25 s, no turns"
    """
    count = turns_of(ways.trajectories[row])
    turns = "no turns" if not count else "1 turn" if count == 1 else f"{count} turns"
    durations = ways.durations
    if row == quickest:
        return f"{durations[row]:.0f} s, {turns}"
    share = durations[row] / durations[quickest] if durations[quickest] > 0 else 1.0
    phrases = ["as long" if share < 1.0 + ALIKE else f"{share:.1f} times as long", turns]
    for name, own, other in zip(ways.front.names, ways.costs[row], ways.costs[quickest], strict=True):
        if name in PLAIN or abs(own - other) <= ALIKE * other:
            continue
        times = f"{own / other:.1f} times the" if other > 0 else "more"
        phrases.append(f"{'almost no' if times.startswith('0.0 ') else times} {_label(name)}")
    return ", ".join(phrases[: 2 + MOST_PHRASES])


def _label(name: str) -> str:
    return printable(name.replace("_", " "))


# Pushes


class Pushed(NamedTuple):
    """The way nearest to a push.

    row       index of the way
    follows   whether it follows the push: always, unless it is the present plan and ``gap`` is above `FOLLOWED`
    gap       mean angle between the way's heading and the push, rad
    """

    row: int
    follows: bool
    gap: float


@lru_cache(maxsize=4)
def beginnings(trajectories: tuple[Trajectory, ...]) -> FloatArray:
    """Return how ways begin, as rows (n, t + 2): headings, rad, over `AHEAD` s, and the advance (x, y), m, by then.

    Ways that begin with the same motions are sampled once. The rows are kept for later pushes among the same ways.
    """
    table, rows, known = MotionTable.of(trajectories), list[FloatArray](), dict[tuple[int, ...], FloatArray]()
    begins = (np.cumsum(table.counts) - table.counts).tolist()
    for trajectory, begin, count in zip(trajectories, begins, table.counts.tolist(), strict=True):
        motions = table.motions[begin : begin + count]
        many = int(np.searchsorted(np.cumsum(table.lasts[motions]), AHEAD + SAMPLED)) + 1
        key = tuple(motions[:many].tolist())
        if key not in known:
            first = part(trajectory, 0, min(many, count))
            states = first.at(np.minimum(np.arange(0.0, AHEAD + 1e-9, SAMPLED), first.duration))
            known[key] = np.append(states.yaw, [states.x[-1] - states.x[0], states.y[-1] - states.y[0]])
        rows.append(known[key])
    return np.stack(rows)


def push_gaps(ways: Ways, heading: float) -> list[tuple[float, float]]:
    """Return by what each way is compared with a push, least first: a mean angle, rad, and minus a distance, m.

    The angle is between the robot's heading and the pushed ``heading``, both in the world, over `AHEAD` s. The distance
    is the one by which the robot advances in the pushed direction in that time.
    """
    rows = beginnings(ways.trajectories)
    gaps = np.abs(wrap(rows[:, :-2] - heading)).mean(axis=1).round(9)
    gained = (rows[:, -2] * math.cos(heading) + rows[:, -1] * math.sin(heading)).round(9)
    return [*zip(gaps.tolist(), (-gained).tolist(), strict=True)]


def nearest_to_push(ways: Ways, heading: float, is_open: Callable[[int], bool] = lambda row: True) -> Pushed | None:
    """Return the way nearest to a push with a ``heading``, rad, in the world; of equals, the present plan.

    is_open  returns whether a way, given by its row, can still be taken; None is returned if none can
    """
    gaps = push_gaps(ways, heading) if ways.trajectories else []
    order = sorted(range(len(gaps)), key=lambda row: (gaps[row], row != ways.present))
    row = next(filter(is_open, order), None)
    if row is None:
        return None
    return Pushed(row, row != ways.present or gaps[row][0] <= FOLLOWED, gaps[row][0])


def first_turn(trajectory: Trajectory) -> str:
    """Return the first turn of a way in words: "turns left by 45 degrees after 1.2 s", or "goes straight on"."""
    yaw = trajectory.model.space.names.index("yaw")
    for motion in perceived_motions(trajectory):
        if motion.kind.startswith("turn"):
            side = "left" if motion.change[yaw] > 0 else "right"
            when = f" after {motion.begin:.1f} s" if motion.begin > 0.05 else ""
            return f"turns {side} by {abs(math.degrees(motion.change[yaw])):.0f} degrees{when}"
    return "goes straight on"
