"""What else a world holds: people and their conversations, landmarks to be seen, zones with rules.

Frozen values in metres and radians, world frame. None of them is an obstacle to the camera. A person who stands blocks the
robot like a column of its radius; one who moves is where :meth:`Person.at` says, at any time.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon, mapping, shape
from shapely.geometry.base import BaseGeometry

from hpop.arrays import Column
from hpop.errors import MapError

ZoneKind = Literal["speed", "keep-out", "one-way"]


@dataclass(frozen=True)
class Person:
    """A person: where, looking where, moving how. The prediction is constant velocity.

    x, y      m
    yaw       rad  heading of the body
    velocity  (x, y) m/s
    radius    m    of the body
    name
    """

    x: float
    y: float
    yaw: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.25
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", tuple(float(v) for v in self.velocity))
        _check_finite(f"person {self.name!r}", self.x, self.y, self.yaw, *self.velocity)
        if len(self.velocity) != 2 or not 0 < self.radius < math.inf:
            raise MapError(f"person {self.name!r} needs a velocity (x, y) and a radius above 0 m; got {self!r}.")

    @property
    def moves(self) -> bool:
        """Whether the person has a velocity."""
        return self.velocity != (0.0, 0.0)

    def at(self, t: Column) -> tuple[Column, Column]:
        """Predicted position (x, y), m, at times t, s."""
        return self.x + self.velocity[0] * t, self.y + self.velocity[1] * t


@dataclass(frozen=True)
class Landmark:
    """A point of interest: an exhibit, a face, a door.

    x, y, z  m
    facing   rad  direction in which its front looks, or None if it looks the same from all sides
    weight   relative importance, above 0
    name
    """

    x: float
    y: float
    z: float = 1.5
    facing: float | None = None
    weight: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        _check_finite(f"landmark {self.name!r}", self.x, self.y, self.z, self.facing or 0.0)
        if not 0 < self.weight < math.inf:
            raise MapError(f"landmark {self.name!r} needs a weight above 0; got {self.weight!r}.")


@dataclass(frozen=True, eq=False)
class Zone:
    """An area with a rule.

    kind       "speed": not faster than ``limit``; "keep-out": not at all; "one-way": only along ``path``
    area       shapely polygon, m
    limit      m/s, of a speed zone
    path       shapely line, m, of a one-way zone, in the direction that is allowed
    name
    """

    kind: ZoneKind
    area: BaseGeometry
    limit: float | None = None
    path: LineString | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in get_args(ZoneKind):
            raise MapError(f"a zone's kind must be one of {', '.join(get_args(ZoneKind))}; got {self.kind!r}.")
        if not isinstance(self.area, Polygon | MultiPolygon) or not self.area.is_valid or self.area.is_empty:
            raise MapError(f"zone {self.name!r} needs a valid polygon as its area; got {self.area!r:.60}.")
        if self.kind == "speed" and not (self.limit is not None and 0 < self.limit < math.inf):
            raise MapError(f"speed zone {self.name!r} needs a limit above 0 m/s; got {self.limit!r}.")
        if self.kind == "one-way" and (not isinstance(self.path, LineString) or self.path.length == 0):
            raise MapError(f"one-way zone {self.name!r} needs a path, a line with a length; got {self.path!r:.60}.")


@dataclass(frozen=True, eq=False)
class Content:
    """All people, conversations, landmarks and zones of a world.

    people     in order
    groups     conversations: places in ``people`` of those who talk with each other, at least two each
    landmarks
    zones
    """

    people: tuple[Person, ...] = ()
    groups: tuple[tuple[int, ...], ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    zones: tuple[Zone, ...] = ()

    def __post_init__(self) -> None:
        for name in ("people", "landmarks", "zones"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "groups", tuple(tuple(group) for group in self.groups))
        for group in self.groups:
            known = all(type(i) is int and 0 <= i < len(self.people) for i in group)
            if len(set(group)) < 2 or len(set(group)) != len(group) or not known:
                raise MapError(
                    f"a group names two or more different people by their places 0 to {len(self.people) - 1}; "
                    f"got {group}."
                )

    @cached_property
    def closed(self) -> BaseGeometry:
        """What is closed to the robot, m: keep-out zones, and the bodies of people who stand."""
        zones = [zone.area for zone in self.zones if zone.kind == "keep-out"]
        bodies = [shapely.Point(p.x, p.y).buffer(p.radius, quad_segs=16) for p in self.people if not p.moves]
        return shapely.union_all([*zones, *bodies]) if zones or bodies else MultiPolygon()

    @property
    def present(self) -> frozenset[str]:
        """What criteria may require of this content."""
        kinds = {
            "people": bool(self.people),
            "moving people": any(person.moves for person in self.people),
            "groups": bool(self.groups),
            "landmarks": bool(self.landmarks),
            "speed zones": any(zone.kind == "speed" for zone in self.zones),
            "one-way zones": any(zone.kind == "one-way" for zone in self.zones),
        }
        return frozenset(name for name, there in kinds.items() if there)

    def describe(self) -> dict[str, Any]:
        """JSON-able description, from which :meth:`build` makes the same content."""
        return {
            "people": [_plain(person) for person in self.people],
            "groups": [list(group) for group in self.groups],
            "landmarks": [_plain(landmark) for landmark in self.landmarks],
            "zones": [
                {**_plain(zone), "area": mapping(zone.area), "path": None if zone.path is None else mapping(zone.path)}
                for zone in self.zones
            ],
        }

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> Content:
        """Content from its description; MapError, TypeError or LookupError where it is malformed."""
        return cls(
            people=tuple(Person(**person) for person in data["people"]),
            groups=tuple(tuple(group) for group in data["groups"]),
            landmarks=tuple(Landmark(**landmark) for landmark in data["landmarks"]),
            zones=tuple(
                Zone(**{**zone, "area": shape(zone["area"]), "path": zone["path"] and shape(zone["path"])})
                for zone in data["zones"]
            ),
        )


def _plain(value: Any) -> dict[str, Any]:
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return {name: list(item) if isinstance(item, tuple) else item for name, item in fields.items()}


def _check_finite(what: str, *numbers: float) -> None:
    if not all(isinstance(n, int | float | np.number) and math.isfinite(n) for n in numbers):
        raise MapError(f"{what} must be given by finite numbers; got {numbers}.")
