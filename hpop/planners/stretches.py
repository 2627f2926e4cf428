"""Many trajectories of one graph made together: fronts have thousands, and one by one they take ten times as long.

All motions of a law are checked at once; trajectories are parts of the same columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, chain, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.math import wrap
from hpop.motions import States
from hpop.trajectory import Trajectory, refuse_impossible

if TYPE_CHECKING:
    from hpop.motions import Model

KINDS = np.array(["move", "turn"], dtype=object)


class Stretch(NamedTuple):
    """A part of a trajectory, or the whole.

    x, y, yaw  (n + 1,)  m and rad, the yaw continuous
    kinds      (n,)      laws of the motions between
    """

    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    kinds: tuple[str, ...]

    @classmethod
    def joined(cls, parts: Sequence[Stretch]) -> Stretch:
        """Parts of which each begins where the one before ends, but for whole turns of the yaw."""
        yaws = [parts[0].yaw]
        for part in parts[1:]:
            whole = 2 * np.pi * np.round((yaws[-1][-1] - part.yaw[0]) / (2 * np.pi))
            yaws.append(part.yaw[1:] + whole)  # so half a turn stays the way round that was checked
        x, y = (np.concatenate([c[i > 0 :] for i, c in enumerate(own)]) for own in list(zip(*parts, strict=True))[:2])
        return cls(x, y, np.concatenate(yaws), tuple(chain.from_iterable(part.kinds for part in parts)))


def stretches(states: States, places: IntArray, sizes: Sequence[int]) -> list[Stretch]:
    """Turns at a place and moves between places, through states one after another, so many (n + 1) for each."""
    kinds = KINDS[(np.diff(places) == 0).astype(np.int64)].tolist()
    turned = wrap(np.diff(states.yaw))
    found = []
    for begin, end in pairwise(accumulate(sizes, initial=0)):
        yaw = states.yaw[begin] + np.concatenate([[0.0], np.cumsum(turned[begin : end - 1])])
        found.append(Stretch(states.x[begin:end], states.y[begin:end], yaw, tuple(kinds[begin : end - 1])))
    return found


def trajectories(model: Model, whole: Sequence[Stretch]) -> tuple[Trajectory, ...]:
    """The trajectories that stretches are; raises ModelError for a motion that is none of its law."""
    if not whole:
        return ()
    names = ("x", "y", "yaw")
    columns = {name: np.concatenate([getattr(stretch, name) for stretch in whole]) for name in names}
    for column in columns.values():
        column.setflags(write=False)
    ends = list(accumulate((stretch.x.size for stretch in whole), initial=0))
    tails = np.delete(np.arange(ends[-1]), np.array(ends[1:]) - 1)
    kinds = np.array(list(chain.from_iterable(stretch.kinds for stretch in whole)), dtype=object)
    states = States(**columns)
    for kind in dict.fromkeys(kinds.tolist()):
        rows = np.flatnonzero(kinds == kind)
        start, end = states.take(tails[rows]), states.take(tails[rows] + 1)
        refuse_impossible(model, model.laws[kind], start, end, rows)
    return tuple(
        Trajectory.of_checked(model, states.take(slice(begin, end)), stretch.kinds)
        for (begin, end), stretch in zip(pairwise(ends), whole, strict=True)
    )
