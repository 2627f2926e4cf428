"""Compute the motion primitives of car-like lattices with CasADi, and write hpop/models/ackermann/primitives.json.

A primitive begins and ends on a lattice of step 1 with 16 headings, with wheels straight ahead. It consists of four
clothoids. For each change of heading, the shortest primitive is kept whose curvature and sharpness (change of the
curvature per length) are within limits; of one length, that of the least sharpness. Run it with ``python
tools/primitives.py``; it takes two minutes.
"""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path

import casadi
import numpy as np

OUT = Path(__file__).parents[1] / "hpop/models/ackermann/primitives.json"
STEPS = ((1, 0), (2, 1), (1, 1))  # the other headings follow by symmetry
CURVATURE, SHARPNESS = 0.25, 0.16
ROOM = 1e-6  # by which IPOPT keeps clear of the limits, for the last Newton steps
CLOTHOIDS = 4
SHORTEST, FARTHEST = 0.2, 9
CHANGES = (-4, -2, -1, 0, 1, 2, 4)  # of the heading, in sixteenths
HEADINGS = [math.atan2(y, x) for x, y in ((1, 0), (2, 1), (1, 1), (1, 2))]
NODES, WEIGHTS = (np.polynomial.legendre.leggauss(20)[i] for i in (0, 1))


def heading(number: int) -> float:
    """Return the heading with a number, rad, without wrapping."""
    turns, inside = divmod(number, 4)
    return HEADINGS[inside] + 0.5 * math.pi * turns


def end_of(lengths, curvatures, yaw: float):
    """Return x, y and yaw at the end of clothoids from the origin, of numbers or symbols."""
    x = y = 0.0
    for i in range(CLOTHOIDS):
        gain = curvatures[i + 1] - curvatures[i]
        for node, weight in zip(0.5 * (NODES + 1), 0.5 * WEIGHTS, strict=True):
            at = yaw + lengths[i] * (curvatures[i] * node + 0.5 * gain * node * node)
            x, y = x + lengths[i] * weight * np.cos(at), y + lengths[i] * weight * np.sin(at)
        yaw = yaw + 0.5 * lengths[i] * (curvatures[i] + curvatures[i + 1])
    return x, y, yaw


def solved(dx: int, dy: int, begin: float, end: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return lengths and curvatures of the least sharp primitive to an end, or None if there is none in the limits."""
    turn, chord = end - begin, math.hypot(dx, dy)
    lengths, inner, sharp = (casadi.SX.sym(name, n) for name, n in (("l", CLOTHOIDS), ("k", CLOTHOIDS - 1), ("s", 1)))
    every = [0.0, *casadi.vertsplit(inner), 0.0]
    miss = casadi.vertcat(*end_of(casadi.vertsplit(lengths), every, begin)) - casadi.vertcat(dx, dy, end)
    gains = [every[i + 1] - every[i] for i in range(CLOTHOIDS)]
    limits = casadi.vertcat(*[sign * gains[i] - sharp * lengths[i] for i in range(CLOTHOIDS) for sign in (1, -1)])
    free = casadi.vertcat(lengths, inner, sharp)
    program = {"x": free, "f": sharp + 0.02 * casadi.sum1(lengths), "g": casadi.vertcat(miss, limits)}
    quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-10}
    solver = casadi.nlpsol("primitive", "ipopt", program, quiet)
    most = CURVATURE - ROOM
    low, high = (-most if turn <= 0 else 0.0), (most if turn >= 0 else 0.0)
    guess = [chord / CLOTHOIDS] * CLOTHOIDS + [1.3 * turn / chord] * (CLOTHOIDS - 1) + [0.1]
    found = solver(
        x0=guess,
        lbx=[SHORTEST] * CLOTHOIDS + [low] * (CLOTHOIDS - 1) + [0],
        ubx=[chord] * CLOTHOIDS + [high] * (CLOTHOIDS - 1) + [SHARPNESS - ROOM],
        lbg=[0] * 3 + [-np.inf] * 2 * CLOTHOIDS,
        ubg=[0] * (3 + 2 * CLOTHOIDS),
    )
    if not solver.stats()["success"]:
        return None
    values = np.array(found["x"]).ravel()[:-1]
    jacobian = casadi.Function("j", [free], [casadi.jacobian(miss, free)[:, :-1], miss])
    for _ in range(5):  # the least correction of lengths and curvatures that closes the gap
        slopes, gap = (np.array(part) for part in jacobian(np.append(values, 0.0)))
        values = values - np.linalg.pinv(slopes) @ gap.ravel()
    return values[:CLOTHOIDS], np.array([0.0, *values[CLOTHOIDS:], 0.0])


def primitives() -> list[dict[str, object]]:
    """Return the primitives of the first three headings, shortest for each change of heading."""
    made: list[dict[str, object]] = []
    for first, step in enumerate(STEPS):
        straight = {"from": first, "to": first, "end": step, "lengths": [math.hypot(*step)], "curvatures": [0, 0]}
        made.append(straight)
        for change in CHANGES:
            begin, end = heading(first), heading(first + change)
            candidates = []
            for dx, dy in product(range(-FARTHEST, FARTHEST + 1), repeat=2):
                off = math.remainder(math.atan2(dy, dx) - 0.5 * (begin + end), 2 * math.pi)
                aside = dy * step[0] - dx * step[1]
                near = 0 < abs(aside) <= 1 if change == 0 else abs(off) <= 0.35 * abs(end - begin)
                if near and abs(off) < 0.5 and 2.0 <= math.hypot(dx, dy) <= FARTHEST:
                    candidates.append((math.hypot(dx, dy), dx, dy, aside))
            sides = (1, -1) if change == 0 else (0,)
            for side in sides:
                for _, dx, dy, aside in sorted(candidates):
                    if side and side * aside < 0:
                        continue
                    found = solved(dx, dy, begin, end)
                    if found is not None:
                        lengths, curvatures = (column.tolist() for column in found)
                        numbers = {"from": first, "to": first + change, "end": [dx, dy]}
                        made.append({**numbers, "lengths": lengths, "curvatures": curvatures})
                        break
    return made


if __name__ == "__main__":
    data = {"curvature": CURVATURE, "sharpness": SHARPNESS, "primitives": primitives()}
    OUT.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
