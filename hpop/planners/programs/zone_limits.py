"""Limits of speed zones along the path of a robot's base, for programs of speed profiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.others.zones import speed_limits
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.fields.field import Field

INSIDE = 1e-9  # share of a zone above which its limit holds
SAMPLES = 1_000_000  # largest number of positions at which a stretch is looked at
HALVINGS = 40  # of the time between two positions, until the border of a zone is found
NEAR = 1e-3  # share of an interval: a border that is nearer to its end is no grid position


@dataclass(frozen=True, eq=False)
class ZoneLimits:
    """Largest speeds that the speed zones of a world allow along a trajectory.

    A limit holds wherever the criterion "speeding" counts it: while the base's axis is in the zone, and up to two or
    three cells of the distance grid beyond its border.

    run    the trajectory, of a robot whose states have x and y
    zones  limits, m/s, each with a field that is above 0 where the limit holds
    """

    run: Trajectory
    zones: tuple[tuple[float, Field], ...]

    @classmethod
    def of(cls, world: World, run: Trajectory) -> ZoneLimits:
        """Return the limits of a world's speed zones along a trajectory; none for a robot without a base."""
        moves = {"x", "y"} <= {*run.model.space.names} and any(zone.kind == "speed" for zone in world.content.zones)
        return cls(run, speed_limits(world) if moves else ())

    def at(self, times: FloatArray) -> FloatArray:
        """Return the largest allowed speed (N,), m/s, at times, s; inf where no limit holds."""
        states, least = self.run.at(times), np.full(times.size, np.inf)
        for limit, inside in self.zones:
            least = np.where(inside(states.x, states.y) > INSIDE, np.minimum(least, limit), least)
        return least

    def on_grid(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the grid (n+1,) of times, s, with the borders of zones added, and the limit (n,) of each interval.

        A border close to a grid position is left out; the whole interval then has the lower limit.
        """
        if not self.zones:
            return times, np.full(times.size - 1, np.inf)
        step = 0.5 * min(inside.spacing for _, inside in self.zones)
        states = self.run.at(times)
        chords = np.hypot(np.diff(states.x), np.diff(states.y))
        counts = np.clip(np.ceil(2.0 * chords / step), 2, max(2, SAMPLES // chords.size)).astype(int)
        share = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        dense = np.append(np.repeat(times[:-1], counts) + share * np.repeat(np.diff(times) / counts, counts), times[-1])
        allowed = self.at(dense)
        (changes,) = (allowed[1:] != allowed[:-1]).nonzero()
        low, high = dense[changes], dense[changes + 1]
        for _ in range(HALVINGS if changes.size else 0):
            middle = 0.5 * (low + high)
            before = self.at(middle) == allowed[changes]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        added = times.tolist()
        for border, here in zip(high.tolist(), np.searchsorted(times, high).tolist(), strict=True):
            slack = NEAR * float(times[here] - times[here - 1])
            if all(abs(border - other) > slack for other in (added[-1], times[here - 1], times[here])):
                added.append(border)
        grid = np.unique(added)
        owner = np.clip(np.searchsorted(grid, dense, side="right") - 1, 0, grid.size - 2)
        limits = np.full(grid.size - 1, np.inf)
        inner = dense != grid[owner]  # a grid position may be on a border
        np.minimum.at(limits, owner[inner], allowed[inner])
        return grid, np.minimum(limits, self.at(0.5 * (grid[1:] + grid[:-1])))


def paces(limits: FloatArray, slopes: States) -> FloatArray:
    """Return the largest ds/dt (n+1,) at grid positions of the path coordinate s, from the limits (n,) between them.

    slopes  derivatives of the states by s at the grid positions
    """
    allowed = np.minimum(np.append(limits, np.inf), np.append(np.inf, limits))
    rate = np.broadcast_to(np.hypot(slopes.x, slopes.y), allowed.shape)
    return np.asarray(np.where(rate > 0.0, allowed / np.where(rate > 0.0, rate, 1.0), np.inf))
