"""A robot that drives in a hall among people who react to it: by a social force, or by walking up to it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

import hpop
from hpop.drive import Options
from hpop.world import Person, World

ROBOT = hpop.DifferentialDrive(radius=0.3)
REACH, BODY = 0.3, 0.25  # m
HALL = World.from_polygons([shapely.box(6.5, 3.6, 7.3, 4.4)], extent=shapely.box(0, 0, 14, 8))
SIZE = (14.0, 8.0)
STEP, EVERY = 0.05, 0.5  # s: of the walk, and between questions
RELAXES, PUSH, RANGE, FASTEST = 0.5, 3.0, 0.3, 1.4  # s, m/s², m, m/s
OVERLAP = 0.02  # m by which who walks up to the robot comes to touch it


@dataclass
class Walker:
    """A person who walks to a place, or up to the robot."""

    name: str
    place: np.ndarray
    goal: np.ndarray
    speed: float
    is_curious: bool
    velocity: np.ndarray

    def walk(self, others: list[Walker], robot: np.ndarray) -> None:
        """Walk for one step: towards the goal, away from others, along walls, and never through the robot."""
        to = (robot if self.is_curious else self.goal) - self.place
        force = (self.speed * to / max(math.hypot(*to), 0.05) - self.velocity) / RELAXES
        bodies = [(one.place, 2 * BODY) for one in others if one is not self]
        for place, size in bodies if self.is_curious else [*bodies, (robot, REACH + BODY)]:
            off = self.place - place
            apart = max(math.hypot(*off), 1e-9)
            force += PUSH * math.exp((size - apart) / RANGE) * off / apart
        for axis, most in enumerate(SIZE):
            low, high = self.place[axis] - BODY, most - self.place[axis] - BODY
            force[axis] += PUSH * (math.exp(-low / RANGE) - math.exp(-high / RANGE))
        self.velocity = self.velocity + STEP * force
        self.velocity *= min(1.0, FASTEST / max(math.hypot(*self.velocity), 1e-9))
        place, least = self.place + STEP * self.velocity, REACH + BODY - OVERLAP * self.is_curious
        off = place - robot
        if math.hypot(*off) < least:
            place = robot + off / math.hypot(*off) * least
            self.velocity = (place - self.place) / STEP
        self.place = place

    def seen(self) -> Person:
        """Return the person as a tracker reports it, predicted to walk on for four seconds."""
        moves = math.hypot(*self.velocity) > 0.02
        velocity = (float(self.velocity[0]), float(self.velocity[1])) if moves else (0.0, 0.0)
        x, y = self.place.tolist()
        return Person(x, y, velocity=velocity, until=4.0 if moves else None, name=self.name)


def crowd(seed: int, shy: int, curious: int) -> list[Walker]:
    """Return people at random positions; the curious ones walk up to the robot."""
    rng = np.random.default_rng(seed)
    return [
        Walker(
            f"{'curious' if i >= shy else 'shy'} {i}",
            np.array([rng.uniform(3, 12), rng.uniform(1, 7)]),
            np.array([rng.uniform(1, 13), rng.uniform(1, 7)]),
            rng.uniform(0.5, 1.2) if i < shy else 0.35,
            i >= shy,
            np.zeros(2),
        )
        for i in range(shy + curious)
    ]


def questions(walkers: list[Walker], most: int) -> Iterator[tuple[float, Options]]:
    """Drive among people, told anew every half second, and yield the options after each, and when; the best is taken.

    The drive ends at the goal or after so many questions.
    """
    problem = hpop.Problem(HALL, ROBOT, (1.0, 2.0, 0.0), (13.0, 2.0, None), ["duration", "length"])
    drive = hpop.follow(problem, problem.solve("lattice", step=0.5), "knee")
    for number in range(1, most + 1):
        for tick in range(round(EVERY / STEP)):
            state = drive.at((number - 1) * EVERY + (tick + 1) * STEP).state
            for walker in walkers:
                walker.walk(walkers, np.array([state.x[0], state.y[0]]))
        now = number * EVERY
        if drive.at(now).arrived:
            return
        drive.world(now, people=[walker.seen() for walker in walkers])
        drive.ready(now)
        options = drive.options(now)
        yield now, options
        if len(options):
            drive.adapt(options)
