"""Content of a world: people and their conversations, landmarks that viewers want to see, and zones with rules.

All values are in metres and radians, in the world frame, and cannot be changed. None of them blocks the view of the
camera. A standing person blocks the robot like a column of its radius. A moving person blocks it at the predicted
positions, see :mod:`hpop.world.content.people`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon, mapping, shape
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, distinct
from hpop.base.options import LEAST
from hpop.base.text import is_whole, python_value, shown
from hpop.errors import MapError
from hpop.world.content.futures import check_radians, named_as, set_numbers
from hpop.world.content.people import Person, described_person, person_from
from hpop.world.geometry.outlines import check_joinable
from hpop.world.geometry.shapes import check_coordinates

__all__ = ["Content", "Landmark", "Person", "Zone"]

ZoneKind = Literal["speed", "keep-out", "one-way"]


@checked_arguments
@dataclass(frozen=True)
class Landmark:
    """Point that viewers want to see: an exhibit, a face, a door.

    x, y, z  m
    facing   rad  direction in which its front points, or None if it looks the same from all sides
    weight   importance relative to other landmarks, above 0
    name     in messages and pictures
    """

    x: float
    y: float
    z: float = 1.5
    facing: float | None = None
    weight: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        what = named_as("landmark", self.name)
        set_numbers(self, what, "x", "y", "z", "weight", *(() if self.facing is None else ("facing",)))
        check_radians(what, "facing", self.facing or 0.0)
        if not self.weight >= LEAST:
            raise MapError(f"{what} needs a weight above {LEAST:g}; got {self.weight!r}.")


@checked_arguments
@dataclass(frozen=True, eq=False)
class Zone:
    """Area with a rule for the robot.

    kind       "speed": drive no faster than ``limit``; "keep-out": stay out; "one-way": drive only along ``path``
    area       shapely polygon, m
    limit      m/s, of a speed zone
    path       shapely line, m, of a one-way zone; it runs in the permitted direction
    name       in messages and pictures
    """

    kind: ZoneKind
    area: BaseGeometry
    limit: float | None = None
    path: LineString | None = None
    name: str = ""

    def __post_init__(self) -> None:
        known = isinstance(self.kind, str) and self.kind in get_args(ZoneKind)
        what = named_as(f"{self.kind} zone" if known else "zone", self.name)
        if not known:
            raise MapError(f"{what}: kind must be one of {', '.join(get_args(ZoneKind))}; got {shown(self.kind)}.")
        if not isinstance(self.area, Polygon | MultiPolygon) or self.area.is_empty:
            raise MapError(f"{what} needs a polygon as its area; got {shown(self.area)}.")
        check_coordinates(self.area, f"{what}: its area")
        check_joinable([self.area], what)
        if not self.area.is_valid:
            reason = shapely.is_valid_reason(self.area)
            raise MapError(f"{what}: its area is no valid polygon ({reason}); repair it with shapely.make_valid.")
        if self.kind == "speed":
            set_numbers(self, what, "limit")
            if not (self.limit and self.limit >= LEAST):
                raise MapError(f"{what} needs a limit above {LEAST:g} m/s; got {self.limit!r}.")
        elif self.limit is not None:
            raise MapError(f"{what} has a limit, {shown(self.limit)}, which only a speed zone has; leave it out.")
        if self.kind == "one-way":
            if not isinstance(self.path, LineString) or not self.path.length > 0:
                raise MapError(f"{what} needs a path, a line with a length, m; got {shown(self.path)}.")
            check_coordinates(self.path, f"{what}: its path")
        elif self.path is not None:
            raise MapError(f"{what} has a path, which only a one-way zone has; leave it out.")


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Content:
    """All people, conversations, landmarks and zones of a world.

    people     people, standing and moving
    groups     conversations: each a tuple of two or more indices into ``people``
    landmarks  objects that the viewer may want to see
    zones      areas of the floor with rules for robots
    left       set by a `Problem`: indices of standing people that the robot touches at its start. The robot may
               move away from each of them, as long as the gap does not shrink.
    kept       set by a `Problem`: clearance, m, that the robot keeps from standing people
    """

    people: tuple[Person, ...] = ()
    groups: tuple[tuple[int, ...], ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    zones: tuple[Zone, ...] = ()
    left: tuple[int, ...] = ()
    kept: float = 0.0

    def __post_init__(self) -> None:
        kinds = {"people": Person, "groups": Iterable, "landmarks": Landmark, "zones": Zone}
        for name, kind in kinds.items():
            given = getattr(self, name)
            try:
                items = tuple(given)
            except TypeError:
                items = None
            if items is None or not all(isinstance(item, kind) for item in items):
                each = "a list of indices into people" if kind is Iterable else f"a {kind.__name__}"
                raise MapError(f"{name} must be a list, each {each}; got {shown(given)}.")
            object.__setattr__(self, name, items)
        object.__setattr__(self, "groups", tuple(tuple(map(python_value, group)) for group in self.groups))
        for group in self.groups:
            known = all(is_whole(i) and 0 <= i < len(self.people) for i in group)
            if not known or len(set(group)) < 2 or len(set(group)) != len(group):
                indices = f"indices 0 to {len(self.people) - 1}" if self.people else "index, but there are no people"
                raise MapError(f"a group must name two or more different people by {indices}; got {shown(group)}.")

    @cached_property
    def closed(self) -> BaseGeometry:
        """Return the region, m, that the robot must not enter: keep-out zones and the bodies of all standing people.

        Bodies are not enlarged by ``kept``, and people in ``left`` are among them; see `World.for_robots`.
        """
        zones = [zone.area for zone in self.zones if zone.kind == "keep-out"]
        bodies = [_body(person, 0.0) for person in self.people if not person.moves]
        return shapely.union_all([*zones, *bodies]) if zones or bodies else MultiPolygon()

    @cached_property
    def bodies(self) -> dict[int, BaseGeometry]:
        """Return the outline of each standing person, m, by index in ``people``, enlarged by the clearance ``kept``."""
        return {i: _body(person, self.kept) for i, person in enumerate(self.people) if not person.moves}

    @cached_property
    def kinks(self) -> FloatArray:
        """Return the sorted times (K,), s, at which the prediction of any person begins, ends or changes velocity."""
        hypotheses = [hypothesis for person in self.people for _, hypothesis in person.hypotheses]
        tracks = [person.track.times for person in hypotheses if person.track is not None]
        ends = [person.until for person in hypotheses if person.until is not None]
        return distinct(np.concatenate([ends, *tracks]))

    @property
    def fastest(self) -> float:
        """Return the greatest predicted speed, m/s, of any person; 0 without people."""
        return max((person.speed for person in self.people), default=0.0)

    @property
    def present(self) -> frozenset[str]:
        """Return the kinds of content that there are, such as "groups" or "speed zones"; a criterion may need some."""
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
        """Return a JSON-able description of people, groups, landmarks and zones; :meth:`build` builds them again.

        The attributes ``left`` and ``kept`` are not described.
        """
        return {
            "people": [described_person(person) for person in self.people],
            "groups": [list(group) for group in self.groups],
            "landmarks": [_plain(landmark) for landmark in self.landmarks],
            "zones": [
                {**_plain(zone), "area": mapping(zone.area), "path": None if zone.path is None else mapping(zone.path)}
                for zone in self.zones
            ],
        }

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> Content:
        """Build content from its description; MapError, TypeError or LookupError if it is malformed."""
        return cls(
            people=tuple(person_from(person) for person in data["people"]),
            groups=tuple(tuple(group) for group in data["groups"]),
            landmarks=tuple(Landmark(**landmark) for landmark in data["landmarks"]),
            zones=tuple(
                Zone(**{**zone, "area": shape(zone["area"]), "path": zone["path"] and shape(zone["path"])})
                for zone in data["zones"]
            ),
        )

    def __repr__(self) -> str:
        counts = (f"{name}: {len(some)}" for name, some in vars(self).items() if some)
        return f"<Content: {', '.join(counts) or 'nothing'}>"


def _body(person: Person, margin: float) -> BaseGeometry:
    """Return a polygon of 64 corners, m, that encloses the body of a standing person, enlarged by a margin, m."""
    return shapely.Point(person.x, person.y).buffer((person.radius + margin) / np.cos(np.pi / 64), quad_segs=16)


def _plain(value: Any) -> dict[str, Any]:
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return {name: list(item) if isinstance(item, tuple) else item for name, item in fields.items()}
