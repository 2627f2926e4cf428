"""Motion primitives of a car-like base, which begin and end on a lattice with wheels straight ahead.

Each primitive is a straight step or four clothoids. The file ``primitives.json`` has those of three headings, on a
lattice of step 1; ``tools/primitives.py`` computed them with CasADi. The others follow by symmetry: a reflection at the
diagonal, and quarter turns.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.models.driven import gauss

if TYPE_CHECKING:
    from hpop.models.ackermann.model import Ackermann

HEADINGS = 16
STEPS = ((1, 0), (2, 1), (1, 1), (1, 2))
HEADING_ANGLES = np.array([math.atan2(y, x) + quarter * 0.5 * math.pi for quarter in range(4) for x, y in STEPS])
LEGS = 4  # clothoids of a primitive
NODES = gauss(20)


@dataclass(frozen=True, eq=False)
class Primitives:
    """All P primitives of the 16 headings, on a lattice of step 1.

    tail, head  (P,)              number of the heading at the start and at the end, 0 to 15
    step        (P, 2)            whole numbers of positions from start to end, along x and y
    knots       (P, LEGS + 1, 3)  at the start and the ends of the clothoids: x and y from the start, and yaw from the
                                  x axis; a straight step ends with the first clothoid
    lengths     (P, LEGS)         lengths of the clothoids; 0 for the last three of a straight step
    curvature   largest curvature of any primitive; on a lattice of step s, it is divided by s
    sharpness   largest change of the curvature per length; on a lattice of step s, it is divided by s²
    """

    tail: IntArray
    head: IntArray
    step: IntArray
    knots: FloatArray
    lengths: FloatArray
    curvature: float
    sharpness: float

    def least_step(self, car: Ackermann) -> float:
        """Return the smallest step, m, of a lattice on which a car can drive all primitives at its cruise speed."""
        bends = self.curvature * car.radius
        rate = car.steering_rate
        return bends if rate is None else max(bends, math.sqrt(car.speed * car.wheelbase * self.sharpness / rate))


@cache
def primitives() -> Primitives:
    """Return the primitives that come with hpop."""
    data = json.loads(files("hpop.models.ackermann").joinpath("primitives.json").read_text(encoding="utf-8"))
    tails, heads, steps, knots, lengths = [list[object]() for _ in range(5)]
    for entry in data["primitives"]:
        for mirrored in (False, True) if entry["from"] == 1 else (False,):
            tail, head, (dx, dy) = entry["from"], entry["to"], entry["end"]
            curvatures = np.array(entry["curvatures"], float)
            if mirrored:  # at the diagonal
                tail, head, dx, dy, curvatures = 4 - tail, 4 - head, dy, dx, -curvatures
            for _ in range(4):
                own = np.zeros(LEGS)
                own[: len(entry["lengths"])] = entry["lengths"]
                tails.append(tail % HEADINGS)
                heads.append(head % HEADINGS)
                steps.append((dx, dy))
                lengths.append(own)
                knots.append(_knots(tail, head, (dx, dy), own, curvatures))
                tail, head, dx, dy = tail + 4, head + 4, -dy, dx
    return Primitives(
        np.array(tails),
        np.array(heads),
        np.array(steps),
        np.array(knots),
        np.array(lengths),
        data["curvature"],
        data["sharpness"],
    )


def _knots(tail: int, head: int, end: tuple[int, int], lengths: FloatArray, curvatures: FloatArray) -> FloatArray:
    """Return x, y and yaw (LEGS + 1, 3) at the start and the ends of clothoids; the last is exactly a lattice state."""
    begin = float(HEADING_ANGLES[tail % HEADINGS])
    rows = [(0.0, 0.0, begin)]
    for length, before, after in zip(lengths, curvatures[:-1], curvatures[1:], strict=False):
        x, y, yaw = rows[-1]
        for node, weight in NODES:
            at = yaw + length * node * (before + 0.5 * (after - before) * node)
            x, y = x + weight * length * math.cos(at), y + weight * length * math.sin(at)
        rows.append((x, y, yaw + 0.5 * length * (before + after)))
    change = math.remainder(float(HEADING_ANGLES[head % HEADINGS]) - begin, 2.0 * math.pi)
    rows[-1] = (*end, begin + change)
    return np.array(rows + rows[-1:] * (LEGS + 1 - len(rows)))
