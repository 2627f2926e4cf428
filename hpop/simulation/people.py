"""People of a simulation: on tracks, in a crowd that reacts to the robot, or moved by a class of one's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.lazy import library
from hpop.base.options import real, whole
from hpop.errors import MapError
from hpop.world import Person, World

Walking = tuple[float, float, float, float]
"""Position, m, and velocity, m/s, of a person: x, y, vx, vy."""
RADIUS = 0.25  # m, of a person
STEP = 0.02  # s, of the crowd
NEAR = 0.6  # m: a person who has come that near to a goal takes another one
STANDS, GIVES_UP = 0.1, 3.0  # m/s, s: a person who is slower for longer, as before the robot, takes another goal
FROM_ROBOT = 1.5  # m, from the robot at which people of a crowd begin, at least
HEAVY, SLOW = 1e9, 1e6  # kg, s: mass and reaction time of the robot in the crowd, which no person pushes away


class Pedestrians(Protocol):
    """People of a simulation. Give an object of a class of your own to let people move as you like.

    radius  m, of a body
    """

    radius: float

    def advance(self, t: float, robot_pose: tuple[float, float, float]) -> list[Walking]:
        """Move on to time ``t``, s, and return all people, always in the same order.

        Times do not decrease. ``robot_pose`` is (x m, y m, yaw rad) of the robot at that time. A person who is absent
        has the position NaN.
        """


class TrackedPeople:
    """People who walk as predicted or recorded (:class:`hpop.world.Person`); of several futures the likeliest.

    people  the people
    keeps   m, between the centres of person and robot: a person who would come nearer to the robot waits, and goes on
            later; 0 for people who walk on through the robot, as a recording does
    """

    def __init__(self, people: Sequence[Person], keeps: float = 0.0) -> None:
        self.keeps = float(real("keeps", keeps, 0.0, 10.0, "a distance in m"))
        self._people = [person.likeliest for person in people]
        self._clocks, self._now = [0.0] * len(self._people), 0.0
        self.radius = max((person.radius for person in self._people), default=RADIUS)

    def advance(self, t: float, robot_pose: tuple[float, float, float]) -> list[Walking]:
        """Move on to time ``t``, s, and return all people; a person who would come nearer than ``keeps`` waits."""
        step, self._now = max(0.0, t - self._now), max(t, self._now)
        robot, walking = np.array(robot_pose[:2]), list[Walking]()
        for i, person in enumerate(self._people):
            before = np.array(person.at(np.float64(self._clocks[i])), float)
            after = np.array(person.at(np.float64(self._clocks[i] + step)), float)
            gap = math.dist(after, robot)
            waits = gap < self.keeps and gap < math.dist(before, robot)
            if not waits:
                self._clocks[i] += step
            x, y = before if waits else after
            vx, vy = (0.0, 0.0) if waits else person.velocity_at(np.float64(self._clocks[i]))
            there = float(person.there(np.float64(self._clocks[i]))) > 0.5
            walking.append((float(x), float(y), float(vx), float(vy)) if there else (math.nan, math.nan, 0.0, 0.0))
        return walking


class Crowd:
    """Crowd by the social-force model of jupedsim (``pip install 'hpop[crowd]'``), which also avoids the robot.

    world   in whose free space people walk to random goals, one after another
    number  of people
    speed   m/s, at which each person walks if nothing is in the way
    radius  m, of a person
    robot   m, radius of the disc by which the crowd avoids the robot
    seed    of all random numbers
    """

    def __init__(
        self,
        world: World,
        number: int,
        *,
        speed: float = 1.0,
        radius: float = RADIUS,
        robot: float = 0.4,
        seed: int = 0,
    ) -> None:
        self._library = library("jupedsim", "a crowd", "crowd")
        self._number = whole("number", number, 1, 1000, "of people")
        self._speed = float(real("speed", speed, 0.1, 3.0, "in m/s"))
        self.radius = float(real("radius", radius, 0.05, 1.0, "in m"))
        self._robot_radius = float(real("robot", robot, 0.05, 5.0, "a radius in m"))
        self._random = np.random.default_rng(whole("seed", seed, 0, 2**31, "a number"))
        self._floor = world.free_space().region
        self._simulation: Any = None
        self._stuck = dict[int, float]()  # s, for which each person has stood
        self._now = 0.0

    def advance(self, t: float, robot_pose: tuple[float, float, float]) -> list[Walking]:
        """Move on to time ``t``, s, with steps of 0.02 s; the first call places the people, unless they have begun."""
        if self._simulation is None:
            self.begin(robot_pose)
        simulation = self._simulation
        for _ in range(round((t - self._now) / STEP)):
            self._now += STEP
            robot = simulation.agent(self._robot)
            x, y = robot.position
            left = max(t - self._now + STEP, STEP)
            robot.model.velocity = ((robot_pose[0] - x) / left, (robot_pose[1] - y) / left)
            for person in self._people:
                agent = simulation.agent(person)
                stands = math.hypot(*agent.model.velocity) < STANDS
                self._stuck[person] = self._stuck.get(person, 0.0) + STEP if stands else 0.0
                if math.dist(agent.position, agent.target) < NEAR or self._stuck[person] > GIVES_UP:
                    agent.target, self._stuck[person] = self._goal(), 0.0
            simulation.iterate()
        agents = [simulation.agent(person) for person in self._people]
        return [(*agent.position, *agent.model.velocity) for agent in agents]

    def begin(self, robot_pose: tuple[float, float, float]) -> None:
        """Place the robot and the people, each with a goal, in the part of the floor on which the robot stands.

        On a large map this takes seconds.
        """
        jps, robot = self._library, shapely.Point(robot_pose[:2])
        parts = [part for part in shapely.get_parts(self._floor) if part.covers(robot)]
        if not parts:
            raise MapError(f"a crowd needs a robot on the map, got ({robot.x:g}, {robot.y:g}); move its start")
        self._floor = parts[0]
        model = jps.SocialForceModel()
        self._simulation = jps.Simulation(model=model, geometry=self._floor, dt=STEP)
        stage = self._simulation.add_direct_steering_stage()
        journey = self._simulation.add_journey(jps.JourneyDescription([stage]))
        given = {"journey_id": journey, "stage_id": stage}
        slow = {"mass": HEAVY, "reaction_time": SLOW, "desired_speed": 1e-3, "radius": self._robot_radius}
        self._robot = self._add(robot, given | slow)
        inner = self._inner(self._floor.difference(robot.buffer(FROM_ROBOT)))
        seed, apart = int(self._random.integers(2**31)), 2.0 * self.radius + 0.1
        try:
            places = jps.distribute_by_number(
                polygon=inner,
                number_of_agents=self._number,
                distance_to_agents=apart,
                distance_to_polygon=0.0,
                seed=seed,
            )
        except jps.AgentNumberError as error:
            raise MapError(f"{self._number} people do not fit on the map: {error}; take fewer") from None
        self._goals = self._inner(self._floor)
        walks = {"desired_speed": self._speed, "radius": self.radius}
        self._people = [self._add(shapely.Point(place), given | walks) for place in places]
        for person in self._people:
            self._simulation.agent(person).target = self._goal()

    def _add(self, place: shapely.Point, parameters: dict[str, Any]) -> int:
        agent = self._library.SocialForceModelAgentParameters(position=(place.x, place.y), **parameters)
        return int(self._simulation.add_agent(agent))

    def _inner(self, floor: BaseGeometry) -> shapely.Polygon:
        """Return the largest part of a floor, m, on which the centre of a person can be."""
        parts = [part for part in shapely.get_parts(floor.buffer(-1.2 * self.radius)) if not part.is_empty]
        if not parts:
            raise MapError("the map has no room for a person; take a smaller radius")
        return shapely.Polygon(max(parts, key=lambda part: part.area))

    def _goal(self) -> tuple[float, float]:
        """Return a random position, m, where a person has room; people walk to it."""
        x_min, y_min, x_max, y_max = self._goals.bounds
        while True:
            x, y = self._random.uniform((x_min, y_min), (x_max, y_max)).tolist()
            if self._goals.contains(shapely.Point(x, y)):
                return x, y
