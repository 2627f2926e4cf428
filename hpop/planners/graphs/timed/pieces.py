"""Motions of a robot in pieces, and where somebody walks meanwhile: how far it leaves the line from begin to end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.planners.graphs.timed.clock import Clock
from hpop.planners.graphs.timed.legs import Leg
from hpop.world.content.people import Person

PIECE = 0.5  # s
BETWEEN = 2  # places a tick at which a way is compared with its chord
Place = tuple[FloatArray, FloatArray]


class Pieces(NamedTuple):
    """Pieces of motions that last no longer than :data:`PIECE`, so that nobody strays far from a chord meanwhile.

    row         (N,)  the arc that each is of
    start, end  x, y (N,), m
    yaw         (N,)  rad, where they begin
    after       (N,)  ticks since the arc was left for
    lasts       (N,)  ticks
    turns       (N,)  whether the yaw changes
    """

    row: IntArray
    start: Place
    end: Place
    yaw: FloatArray
    after: IntArray
    lasts: IntArray
    turns: BoolArray

    @classmethod
    def of(cls, leg: Leg, clock: Clock) -> Pieces:
        """Those of motions of one kind."""
        ticks = clock.of(leg.lasts)
        count = -(-ticks // max(1, clock.within(PIECE)))
        owner = np.repeat(np.arange(ticks.size), count)
        number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        first, last = (part * ticks[owner] // count[owner] for part in (number, number + 1))
        after = np.rint(leg.after / clock.tick).astype(np.int64)[owner] + first
        x, y, to_x, to_y = (column[owner] for column in (leg.start.x, leg.start.y, leg.end.x, leg.end.y))
        shares = first / ticks[owner], last / ticks[owner]
        start, end = ((x + share * (to_x - x), y + share * (to_y - y)) for share in shares)
        rows = np.flatnonzero(leg.of >= 0)
        row = np.empty(ticks.size, np.int64)
        row[leg.of[rows]] = rows
        turns = np.full(owner.size, leg.kind != "move")
        return cls(row[owner], start, end, leg.start.yaw[owner], after, last - first, turns)

    def take(self, rows: IntArray) -> Pieces:
        """Some of them."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        return Pieces(self.row[rows], start, end, self.yaw[rows], self.after[rows], self.lasts[rows], self.turns[rows])


class Walked(NamedTuple):
    """Where somebody walks during motions (N,).

    ends   x, y (N,), m, at their begin and at their end
    stray  (N,)  m, how far it leaves the line between these, walked evenly
    there  (N,)  whether it is there at any time of them
    """

    ends: tuple[Place, Place]
    stray: FloatArray
    there: BoolArray

    @classmethod
    def of(cls, person: Person, tick: IntArray, lasts: IntArray, clock: Clock) -> Walked:
        """During motions that begin at ticks (N,) and last so many."""
        most = int(lasts.max(initial=1)) + 1
        keys, which = np.unique(tick * most + lasts, return_inverse=True)
        begin, count = keys // most, keys % most
        share = np.linspace(0.0, 1.0, BETWEEN * most + 1)
        seconds = (begin[:, None] + share * count[:, None]) * clock.tick
        x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
        there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape)
        off_x = x - (x[:, :1] + share * (x[:, -1:] - x[:, :1]))
        off_y = y - (y[:, :1] + share * (y[:, -1:] - y[:, :1]))
        stray = np.hypot(off_x, off_y).max(axis=1)
        ends = ((x[which, 0], y[which, 0]), (x[which, -1], y[which, -1]))
        present = np.asarray(np.max(there, axis=1) > 0)
        return cls(ends, stray[which], present[which])

    def seen_from(self, pieces: Pieces) -> tuple[Place, Place]:
        """Ways (x, y), m, from the robot to the person at both ends of pieces."""
        (x, y), (to_x, to_y) = self.ends
        (ax, ay), (bx, by) = pieces.start, pieces.end
        return (x - ax, y - ay), (to_x - bx, to_y - by)
