"""Stops of a tour: sets of states in which the robot stands for a while."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, cast

from hpop.base.arguments import checked_arguments
from hpop.base.options import LEAST, MOST, real, truth
from hpop.base.registry import goals
from hpop.base.text import shown
from hpop.errors import QueryError, did_you_mean
from hpop.goals.base import Goal, GoalSet, checked_goal
from hpop.goals.region import checked_numbers
from hpop.motions.laws import LONGEST

if TYPE_CHECKING:
    from hpop.motions import Model
    from hpop.world import World

NEAR = 3.0  # m: default of the largest distance from which the camera sees a landmark
FORMS = "at with within, a goal such as look_at, or landmark"


@checked_arguments
@dataclass(frozen=True)
class TourStop:
    """Stop of a tour: a set of states, in one of which the robot stands for a while.

    Exactly one of ``at``, ``goal`` and ``landmark`` is given.

    at        m  (x, y): position near which the base stands, with any heading
    goal      any goal of :mod:`hpop.goals`, in the forms that a problem takes; a target of ``look_at`` must be visible
    landmark  name of a landmark of the world that the camera must see from nearby
    within    m  radius of the disc about ``at``, or largest distance between camera and landmark (3 by default)
    dwell     s  time for which the robot stands there; with 0, a motion only begins or ends there
    name      shown in messages, tables and pictures; default: name of the landmark, or "stop" with its number from 1
    optional  whether the tour may skip it, which costs in the criterion ``stops_missed``
    """

    at: tuple[float, float] | None = None
    goal: Any = None
    landmark: str | None = None
    within: float | None = None
    dwell: float = 0.0
    name: str = ""
    optional: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise QueryError(f"the name of a stop must be text, got {shown(self.name)}")
        name = self.name or (self.landmark if isinstance(self.landmark, str) else "")
        object.__setattr__(self, "name", name)
        what = f"stop {name!r}" if name else "a stop"
        given = [key for key in ("at", "goal", "landmark") if getattr(self, key) is not None]
        if len(given) != 1:
            raise QueryError(f"{what} must have exactly one of {FORMS}; got {' and '.join(given) or 'none'}")
        if self.at is not None:
            x, y = checked_numbers(f"at of {what}", self.at, 2, "(x, y) in m")
            object.__setattr__(self, "at", (x, y))
        if self.landmark is not None and not isinstance(self.landmark, str):
            raise QueryError(f"landmark of {what} must be the name of a landmark, got {shown(self.landmark)}")
        within = NEAR if self.within is None and self.landmark is not None else self.within
        if self.at is not None and within is None:
            raise QueryError(f"{what} at a position needs within, the radius in m of the disc in which it is visited")
        if self.goal is None:
            kind = "a length in m"
            within = float(real(f"within of {what}", within, LEAST, MOST, kind, error=QueryError))
        elif within is not None:
            raise QueryError(f"within of {what} is only for at and landmark; a goal has its own bounds. Leave it out")
        object.__setattr__(self, "within", within)
        dwell = real(f"dwell of {what}", self.dwell, 0, LONGEST, "a time in s", error=QueryError)
        object.__setattr__(self, "dwell", float(dwell))
        object.__setattr__(self, "optional", truth(f"optional of {what}", self.optional, error=QueryError))

    @classmethod
    def of(cls, spec: Any) -> TourStop:
        """Build a stop from a mapping of its fields; instead of ``goal``, the name of a goal may be a key."""
        if isinstance(spec, TourStop):
            return spec
        if not isinstance(spec, Mapping):
            raise QueryError(f"a stop must be a mapping with {FORMS}, got {shown(spec)}")
        known = [field.name for field in fields(cls)]
        own = {str(key): value for key, value in spec.items() if key in known}
        for key in spec:
            if key in known:
                continue
            if key not in goals:
                hint = did_you_mean(key, [*known, *goals])
                raise QueryError(
                    f"{shown(key)} is not a key of a stop.{hint} A stop takes {', '.join([*known, *goals])}"
                )
            if own.get("goal") is not None:
                raise QueryError(f"a stop must have one goal, got {shown(key)} beside another; leave one out")
            own["goal"] = {key: spec[key]}
        return cls(**own)

    @property
    def target(self) -> Goal | None:
        """Goal as an object; None for a position or a landmark. Use this only on a stop from :meth:`Tour.on`."""
        return GoalSet((self.goal,)) if isinstance(self.goal, tuple) else self.goal

    def on(self, model: Model, world: World) -> TourStop:
        """Return the stop with its goal as an object; raise QueryError if the stop does not fit the model or world."""
        if self.at is not None and not ({"x", "y"} <= set(model.space.names) and "base" in model.provides):
            raise QueryError(
                f"stop {self.name!r} is a position of the base (at), but {model.name} has none; give a goal such as "
                "tool_at or look_at"
            )
        if self.at is not None:
            (x, y), (x0, y0, x1, y1) = self.at, world.bounds
            if math.hypot(x - min(max(x, x0), x1), y - min(max(y, y0), y1)) > cast(float, self.within):
                raise QueryError(
                    f"stop {self.name!r} cannot be visited: at ({x:g}, {y:g}) it is outside the map, which spans "
                    f"x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to {y1:.2f} m. Move the stop"
                )
        if self.landmark is not None:
            landmarks = world.content.landmarks
            count = sum(mark.name == self.landmark for mark in landmarks)
            if not count:
                names = [mark.name for mark in landmarks if mark.name]
                raise QueryError(
                    f"stop {self.name!r}: no landmark is called {shown(self.landmark)}."
                    f"{did_you_mean(self.landmark, names)} Landmarks with a name are {', '.join(names) or 'none'}"
                )
            if count > 1:
                raise QueryError(
                    f"stop {self.name!r}: {count} landmarks are called {shown(self.landmark)}; give each a name of its "
                    "own"
                )
            if "camera" not in model.provides:
                raise QueryError(f"stop {self.name!r} needs a camera, which {model.name} does not have; leave it out")
        if self.goal is None:
            return self
        stop = replace(self, goal=checked_goal(self.goal, model.space))
        target = stop.target
        if target is not None and (absent := sorted(target.requires - model.provides)):
            raise QueryError(
                f"stop {self.name!r} requires {', '.join(absent)}, which the model does not have; give another goal"
            )
        if target is not None and any(each.straight is not None for each in target.alternatives()):
            raise QueryError(
                f"stop {self.name!r} cannot have an approach: only the goal of a problem can. Leave it out"
            )
        return stop

    def place(self, world: World) -> tuple[float, float] | None:
        """Return the position (x, y), m, at which pictures mark the stop; None if there is none.

        It is the position of the stop, its landmark, or a target or state of its goal.
        """
        if self.at is not None:
            return self.at
        if (place := self.place_in_space(world)) is not None:
            return place[:2]
        listed = self.target.listed if self.target is not None else ()
        first = listed[0][:2] if listed else ()
        return (float(first[0]), float(first[1])) if len(first) == 2 and None not in first else None  # type: ignore[arg-type]

    def place_in_space(self, world: World) -> tuple[float, float, float] | None:
        """Return the position (x, y, z), m, of the stop's landmark or of the target of its goal; None without one."""
        for mark in world.content.landmarks if self.landmark is not None else ():
            if mark.name == self.landmark:
                return mark.x, mark.y, mark.z
        places = self.target.places if self.target is not None else ()
        return places[0] if places else None

    def describe(self) -> dict[str, Any]:
        """Return the stop as JSON, without default values. Use this only on a stop from :meth:`Tour.on`."""
        target = self.target
        values: dict[str, Any] = {"at": None if self.at is None else list(self.at), "landmark": self.landmark}
        values |= {"goal": None if target is None else target.describe(), "within": self.within, "name": self.name}
        values |= {"dwell": self.dwell or None, "optional": self.optional or None}
        return {key: value for key, value in values.items() if value is not None}
