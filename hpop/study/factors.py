"""Factors of a study beside the trajectory: announcement, latency and restriction of the view, and the setting.

Each level of each factor is combined with each row of the front. A combination is a condition with its own letter, so
that factors are counterbalanced as trajectories are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from hpop.base.options import one_of, real
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.trajectories.poses import poses
from hpop.trajectories.trajectory import Trajectory

Level = float | str | None
Levels = dict[str, Level]
SETTINGS = {"simulation": "ride", "video": "video", "live": "robot"}
"""Kind of a condition by the level of the factor "setting"; "live" is a real robot, which the researcher runs."""
NUMBERS = {
    "cue": (0.5, 10.0, "s before a turn at which it is announced"),
    "latency": (0.0, 10.0, "s by which the view lags"),
    "restrictor": (20.0, 170.0, "degrees of view while it turns"),
}
FACTORS = (*NUMBERS, "setting")
EXAMPLES = {
    "cue": "['none', 2] (not announced, and 2 s ahead)",
    "latency": "[0, 0.5] (s)",
    "restrictor": "['none', 80] (full view, and 80 degrees)",
    "setting": "['simulation', 'live']",
}


def crossed(factors: Mapping[str, Sequence[Level]]) -> list[Levels]:
    """Return all combinations of the levels of some factors; [{}] without factors. StudyError for invalid ones.

    >>> crossed({"latency": [0, 0.5], "cue": [None, 2]})[1]
    {'latency': 0.0, 'cue': 2.0}
    """
    if not isinstance(factors, Mapping):
        raise StudyError(f"factors must be levels by name, such as {{'latency': [0, 0.5]}}, got {shown(factors)}")
    known: dict[str, list[Level]] = {}
    for name, levels in factors.items():
        one_of("each factor", name, FACTORS, error=StudyError)
        if isinstance(levels, str) or not isinstance(levels, Sequence) or not levels:
            raise StudyError(f"factor {name} must have a list of levels, such as {EXAMPLES[name]}, got {shown(levels)}")
        known[name] = [checked_level(name, level) for level in levels]
        if len(set(known[name])) < len(known[name]):
            raise StudyError(f"factor {name} must have each level once, got {shown(list(levels))}")
    return [dict(zip(known, combination, strict=True)) for combination in product(*known.values())]


def checked_level(name: str, level: object) -> Level:
    """Return a level of a factor, with None for "none"; StudyError if it is invalid."""
    if name == "setting":
        return one_of("a level of setting", level, SETTINGS, error=StudyError)
    if level is None or level == "none":
        return None
    low, high, kind = NUMBERS[name]
    return float(real(f"a level of {name}", level, low, high, f"none, or {kind},", error=StudyError))


SLOW, BRIEF, LEAST = 0.1, 0.5, np.radians(20.0)
"""A turn is faster than SLOW, rad/s, with pauses shorter than BRIEF, s, and of at least LEAST rad to one side."""
RATE = 20.0


def turns(trajectory: Trajectory) -> list[tuple[float, str]]:
    """Return the time, s, at which each turn of the executed camera begins, and its side, "left" or "right"."""
    run = poses(trajectory, rate=RATE)
    side = np.where(np.abs(run.yaw_rates) > SLOW, np.sign(run.yaw_rates), 0.0)
    moving = np.flatnonzero(side)
    is_new = (np.diff(run.times[moving]) >= BRIEF) | (np.diff(side[moving]) != 0.0)
    found: list[tuple[float, str]] = []
    for group in np.split(moving, np.flatnonzero(is_new) + 1) if moving.size else ():
        before, after = max(int(group[0]) - 1, 0), min(int(group[-1]) + 1, len(run) - 1)
        turned = float(run.yaws[after] - run.yaws[before])
        if abs(turned) >= LEAST:
            found.append((round(float(run.times[before]), 3), "left" if turned > 0 else "right"))
    return found


def shown_part(levels: Levels, trajectory: Trajectory, *, still: bool) -> dict[str, Any]:
    """Return the entries of a stimulus page for its factors.

    latency     s
    restrictor  degrees; None for no restriction
    cues        for each turn that is announced: time of the announcement and of the turn, s, and its side

    Without a level of "cue", and in the ``still`` view, no turn is announced.
    """
    cue = levels.get("cue")
    announced = [] if cue is None or still else turns(trajectory)
    return {
        "latency": levels.get("latency") or 0.0,
        "restrictor": levels.get("restrictor"),
        "cues": [[max(0.0, round(t - float(cue or 0), 3)), t, side] for t, side in announced],
    }
