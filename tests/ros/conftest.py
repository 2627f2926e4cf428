"""A room whose planner is served, and a bridge to serve it over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

import pytest
import shapely

import hpop
from hpop.ros import Bridge, GoalPlanner, Interface, PathServer
from tests.ros.bridge import FakeBridge, fake_bridge

DELAYS = (1e-3, 8e-3)  # s
WALL = shapely.box(3.8, 0, 4.2, 4)


@pytest.fixture(scope="session")
def room() -> hpop.Problem:
    """Return a room of 8 x 6 m with a wall that leaves a door, and beyond it a closet that cannot be reached."""
    closet = shapely.box(6, 0, 8, 2).difference(shapely.box(6.2, 0, 8, 1.8))
    world = hpop.World.from_polygons([WALL, closet], extent=shapely.box(0, 0, 8, 6))
    return hpop.Problem(world, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (7, 5, None), ["turns", "length"])


@pytest.fixture(scope="session")
def planning(room: hpop.Problem) -> GoalPlanner:
    made = GoalPlanner(room, [hpop.planners.graph_planners.Lattice(step=0.5)], Interface())
    made.rehearsed()
    return made


class Gate(GoalPlanner):
    """Planning that goes on until it is let through, and says how it ended; then it answers as usual."""

    def __init__(self, other: GoalPlanner) -> None:
        super().__init__(other.problem, other.planners, other.known)
        self.entered, self.open, self.left = Event(), Event(), Event()

    def answer(self, goal: Any, robot: Any, progress: Any = None) -> Any:
        self.entered.set()
        try:
            while not self.open.wait(1e-3):
                progress(hpop.runtime.limits.Progress("search"))
            return super().answer(goal, robot, progress)
        finally:
            self.left.set()


@pytest.fixture
def gate(planning: GoalPlanner) -> Gate:
    return Gate(planning)


class Said(list[str]):
    """Lines that were said."""

    def __init__(self) -> None:
        super().__init__()
        self.told = Event()

    def __call__(self, line: str) -> None:
        self.append(line)
        self.told.set()


@pytest.fixture
def said() -> Said:
    return Said()


@contextmanager
def running(planning: GoalPlanner, url: str, say: Callable[[str], None]) -> Iterator[Bridge]:
    """Serve a planner until the block ends."""
    server = PathServer(planning, say=say)
    bridge = Bridge(url, server, say=say, delays=DELAYS)
    thread = Thread(target=bridge.run)
    thread.start()
    try:
        yield bridge
    finally:
        bridge.stop()
        thread.join()
        server.close()


@pytest.fixture
def bridge() -> Iterator[FakeBridge]:
    with fake_bridge() as made:
        yield made


@pytest.fixture
def served(bridge: FakeBridge, planning: GoalPlanner, said: Said) -> Iterator[FakeBridge]:
    """Offer the room's planner over a bridge."""
    with running(planning, bridge.url, said):
        yield bridge
