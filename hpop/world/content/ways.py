"""The line along which somebody walks, with times: where it enters an area, and where it leaves one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.world.content.people import STANDS, Person

TOUCH = 1e-9
"""m, below which a line only touches an area, or goes on in it."""

Span = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Way:
    """A line of straight legs, walked.

    times   (N,)    s  at its points
    points  (N, 2)  m
    """

    times: FloatArray
    points: FloatArray

    @classmethod
    def of(cls, person: Person, bounds: tuple[float, float, float, float]) -> Way | None:
        """The way of a person of one future, from now on until it is surely out of bounds; None of who stands."""
        if person.track is not None:
            track = person.track.later(0.0)
            points = np.stack([track.x, track.y], axis=1)
            if track.begin < 0:
                points[0] = person.x, person.y
            return cls(np.maximum(track.times, 0.0), points)
        if person.velocity == STANDS:
            return None
        x0, y0, x1, y1 = bounds
        here, middle = np.array([person.x, person.y]), np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        time = (2 * math.hypot(x1 - x0, y1 - y0) + math.dist(here, middle)) / person.speed
        return cls(np.array([0.0, time]), np.stack([here, here + time * np.array(person.velocity)]))

    @cached_property
    def lengths(self) -> FloatArray:
        """How far each point is along the line (N,), m."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])

    def time(self, length: float) -> float:
        """When the walker has come so far along the line, s."""
        leg = int(np.searchsorted(self.lengths, length, side="left"))
        if leg == 0:
            return float(self.times[0])
        leg = min(leg, self.times.size - 1)
        share = (length - self.lengths[leg - 1]) / (self.lengths[leg] - self.lengths[leg - 1])
        return float(self.times[leg - 1] + min(share, 1.0) * (self.times[leg] - self.times[leg - 1]))

    def enters(self, area: BaseGeometry, beyond: float = 0.0) -> float | None:
        """How far along the line it first enters an area, m; None: nowhere. To follow its border is not to enter.

        What is behind ``beyond``, m, already does not count: somebody who steps out of the area at the beginning.
        """
        for begin, end in self._spans(area):
            if end > beyond and shapely.contains_xy(area, *self._place((begin + end) / 2)):
                return begin
        return None

    def leaves(self, area: BaseGeometry) -> float | None:
        """How far along the line it leaves an area, m: 0 if it is never in it; None if it never leaves."""
        spans = self._spans(area)
        if not spans:
            stays = self.lengths[-1] == 0.0 and area.covers(shapely.Point(self.points[0]))
            return None if stays else 0.0
        left = spans[0][1]
        for begin, end in spans[1:]:
            if begin > left + TOUCH:
                break
            left = max(left, end)
        return None if left >= self.lengths[-1] - TOUCH else left

    def _place(self, length: float) -> tuple[float, float]:
        x, y = (float(np.interp(length, self.lengths, column)) for column in self.points.T)
        return x, y

    def _spans(self, area: BaseGeometry) -> list[Span]:
        """Parts of the line in an area, border included, by how far along they begin and end, m; in order."""
        legs = np.stack([self.points[:-1], self.points[1:]], axis=1)  # (N-1, 2, 2)
        lines: Any = shapely.linestrings(legs)
        shapely.prepare(area)
        steps = np.diff(self.lengths)
        covered: Any = shapely.covers(area, lines)
        near: BoolArray = np.asarray(shapely.intersects(area, lines)) & (steps > 0)
        spans = list[Span]()
        for leg in np.flatnonzero(near).tolist():
            begin, length = float(self.lengths[leg]), float(steps[leg])
            if covered[leg]:
                spans.append((begin, begin + length))
                continue
            ahead = (legs[leg, 1] - legs[leg, 0]) / length
            for part in shapely.get_parts(shapely.intersection(lines[leg], area)):
                along = (shapely.get_coordinates(part) - legs[leg, 0]) @ ahead
                if along.max() - along.min() > TOUCH:
                    spans.append((begin + float(along.min()), begin + float(along.max())))
        return sorted(spans)
