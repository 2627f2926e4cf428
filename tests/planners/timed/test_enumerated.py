"""Fronts among people are those of all plans in a small grid, by distances in time that share no code with hpop.

An enumerated plan counts as safe if it keeps the documented distances with the largest deviations from clock and plan,
and as allowed if it keeps the rule of contact at all. The front must cover every safe plan, and hold allowed ones only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest
import shapely

from hpop.errors import QueryError
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Future, Person, World
from tests.planners.timed.rooms_with_people import GridRobot, Motion, State, motions_in_a_grid

PACE = {"speed": 1.0, "acceleration": 2.5, "turn_rate": math.pi / 0.8, "turn_acceleration": math.pi / 0.16}
TICKS = (0.4, 0.2, 2, 5, 7, 1)  # m, s, then ticks of a move, a quarter turn, a half turn and of standing before moves
ROUND = GridRobot(DifferentialDrive(radius=0.1, **PACE), *TICKS)
CORNERS = ((0.15, 0.08), (-0.15, 0.08), (-0.15, -0.08), (0.15, -0.08))
LONG = GridRobot(DifferentialDrive(footprint=CORNERS, **PACE), *TICKS)
CREEPS = {"speed": 0.2, "acceleration": 0.5, "turn_rate": math.pi / 4, "turn_acceleration": math.pi / 2.4}
SLOW = GridRobot(DifferentialDrive(radius=0.1, **CREEPS), *(0.4, 0.2, 10, 15, 25, 1))
STRAY, SLACK, LEAVING, SOON = 0.05, 0.2, 5.0, 1.0  # m: v²/8a; s: as documented
SIGMAS, RISK = 1.6449, 0.05
PIECE = 0.5  # s: a person counts as present until the end of a piece of a motion, with its largest uncertainty
DT = 0.02  # s
ROUNDED = 1e-3  # m: contact is found to a millimetre
OUTSIDE = 0.3  # m of floor about the grid
AWAY = 1e3  # m: the gap to a person who is not there


@dataclass(frozen=True)
class Case:
    """A query on a grid of (columns, rows) cells."""

    people: tuple[Person, ...]
    robot: GridRobot = ROUND
    margin: float = 0.0
    hold: float | None = 1.0
    start: State = (0, 0, 0)
    goal: tuple[int, int] = (3, 0)
    size: tuple[int, int] = (4, 2)
    ticks: int = 28

    @property
    def stray(self) -> float:
        """Largest distance, m, of the robot from its plan."""
        return STRAY

    @property
    def lowest(self) -> tuple[float, float]:
        """Corner of the floor, m."""
        return -OUTSIDE, -OUTSIDE

    @property
    def planner(self) -> dict[str, Any]:
        """Options of the lattice."""
        return {"step": self.robot.step}

    @property
    def criteria(self) -> list[str]:
        return ["duration", "length", "turns"]

    def costs(self, motions: Sequence[Motion], ticks: int) -> tuple[float, float, float]:
        """Return duration, s, length, m, and turns of a plan."""
        kinds = [kind for kind, _ in motions]
        return ticks * self.robot.tick, self.robot.step * kinds.count("move"), float(kinds.count("turn"))

    def lasts(self, kind: str, amount: int) -> int:
        """Return the ticks of a motion."""
        if kind == "turn":
            return self.robot.half if amount == 2 else self.robot.quarter
        return self.robot.move if kind == "move" else amount

    @property
    def problem(self) -> Problem:
        (x, y, heading), step = self.start, self.robot.step
        highest = [step * (count - 1) + OUTSIDE for count in self.size]
        world = World.from_polygons([], extent=shapely.box(*self.lowest, *highest))
        start, goal = (x * step, y * step, heading * math.pi / 2), (*(step * i for i in self.goal), None)
        crowded = world.with_content(people=self.people)
        return Problem(crowded, self.robot.model, start, goal, self.criteria)

    def front(self) -> tuple[Problem, Front]:
        """Return the problem, and the front of the lattice."""
        problem, robot = self.problem, self.robot
        latest = self.ticks * robot.tick
        options = {"clock": robot.tick, "hold": self.hold, "margin": self.margin, "arrive_by": latest}
        return problem, problem.solve(Lattice(**self.planner, headings=4, **options))

    def plans(self) -> Iterator[tuple[tuple[float, ...], list[Motion]]]:
        """Yield the costs of all plans, and their motions."""
        hold = None if self.hold is None else round(self.hold / self.robot.tick)
        for motions, ticks in motions_in_a_grid(self.robot, self.start, self.goal, self.size, self.ticks, hold):
            yield self.costs(motions, ticks), motions


class Drive(NamedTuple):
    """A robot at moments DT apart: position, m, heading, rad, and what it does: "move", "turn" or "hold"."""

    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    kind: np.ndarray


def driven(case: Case, motions: Sequence[Motion]) -> Drive:
    """Return a plan as it is driven, and half a second at its goal."""
    robot, (column, row, heading) = case.robot, case.start
    columns = []
    for kind, amount in [*motions, ("hold", round(0.4 / robot.tick))]:
        seconds = case.lasts(kind, amount) * robot.tick
        share = np.arange(round(seconds / DT)) * DT / seconds
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading] if kind == "move" else (0, 0)
        turned = amount if "turn" in kind else 0
        yaw = (heading + turned * share) * math.pi / 2
        columns.append((robot.step * (column + dx * share), robot.step * (row + dy * share), yaw, [kind] * share.size))
        column, row, heading = column + dx, row + dy, (heading + turned) % 4
    return Drive(*(np.concatenate(parts) for parts in zip(*columns, strict=True)))


def to_box(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the distance, m, of points in the robot's frame from the long robot's outline, below 0 within it."""
    over_x, over_y = np.abs(x) - CORNERS[0][0], np.abs(y) - CORNERS[0][1]
    return np.hypot(np.maximum(over_x, 0), np.maximum(over_y, 0)) + np.minimum(np.maximum(over_x, over_y), 0)


def gap(
    case: Case, drive: Drive, person: Person, times: np.ndarray, *, swept: bool = False, more: float = 0.0
) -> np.ndarray:
    """Return the gaps, m, between the surfaces.

    swept  whether a robot that turns or stands counts as a disc
    more   s, for which a person who has left still counts
    """
    px, py = (np.broadcast_to(column, times.shape) for column in person.at(np.maximum(times, 0.0)))
    x, y = px - drive.x, py - drive.y
    apart = np.hypot(x, y)
    if case.robot is not LONG:
        found = apart - 0.1
    else:
        cos, sin = np.cos(drive.yaw), np.sin(drive.yaw)
        found = to_box(cos * x + sin * y, cos * y - sin * x)
        if swept:
            found = np.where(drive.kind == "move", found, apart - math.hypot(*CORNERS[0]))
    there = np.broadcast_to(person.there(np.maximum(times - more, 0.0)), times.shape) > 0
    return np.where(there, found - person.radius, AWAY)


def deviation(person: Person, times: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.asarray(person.deviation(np.maximum(times, 0.0)), float), times.shape)


def is_prefix(marks: np.ndarray) -> bool:
    """Return whether marks are at the beginning only."""
    return not marks.any() or (marks[0] and marks[: int(marks.sum())].all())


def is_safe(case: Case, drive: Drive, people: Sequence[Person]) -> bool:
    """Return whether a plan keeps clear of all people, however far clock and robot are off; or leaves them in time.

    Between two moments a gap changes by no more than both speeds allow.
    """
    times = np.arange(drive.x.size) * DT
    ahead = np.stack([np.cos(drive.yaw), np.sin(drive.yaw)]) * (drive.kind == "move")
    for person in people:
        between = (person.speed + 1.0) * DT / 2
        least = np.full(times.size, np.inf)
        for off in (-SLACK, -SLACK / 2, 0.0, SLACK / 2, SLACK):
            for stray in (-case.stray, 0.0, case.stray):
                there = drive._replace(x=drive.x + stray * ahead[0], y=drive.y + stray * ahead[1])
                found = gap(case, there, person, times + off, swept=True, more=PIECE)
                found -= SIGMAS * deviation(person, times + off + PIECE)
                least = np.minimum(least, found - case.stray * (drive.kind != "move"))
        if math.isfinite(person.settled):  # near a prediction's end its path is replaced by a chord
            least -= 0.25 * PIECE * person.speed * (np.abs(times - person.settled) < PIECE + SLACK)
        least -= between
        near = least < case.margin
        if not near.any():
            continue
        leaves = is_prefix(near) and near.sum() * DT < LEAVING - SLACK
        waits = near & (drive.kind == "hold") & (times >= case.robot.stands * case.robot.tick)
        exact = gap(case, drive, person, times, swept=True) - SIGMAS * deviation(person, times)
        if not leaves or waits.any() or exact[0] >= case.margin:
            return False
        touching = least < 0
        if touching.any():
            steps = [column[:-1] + 0.01 * np.diff(column) for column in drive[:3]]  # a gap may shrink only at first
            for off in (-SLACK, 0.0, SLACK):
                soon = gap(case, Drive(*steps, drive.kind[:-1]), person, times[:-1] + off + 0.01 * DT, more=PIECE)
                now = gap(case, drive, person, times + off, more=PIECE)
                grows = (np.diff(now) >= 0) & (soon >= now[:-1])
                if exact[0] >= 0 or not is_prefix(touching) or not grows[: touching.sum()].all():
                    return False
    return True


def risk(case: Case, drive: Drive, person: Person, times: np.ndarray, margin: float) -> np.ndarray:
    """Return the share of a person's distribution nearer than a margin: 0 or 1 for a certain one."""
    sigma = deviation(person, times)
    if not sigma.any():
        return (gap(case, drive, person, times) < margin - ROUNDED).astype(float)
    rng = np.random.default_rng(0)
    share = np.zeros(times.size)
    normal = rng.normal(size=(4000, 2))
    near = np.flatnonzero(gap(case, drive, person, times) < margin + 4 * sigma)
    for i in near.tolist():
        spread = replace(person, spread=0.0, growth=0.0)
        one = Drive(*(np.full(4000, column[i]) for column in drive))
        moved = one._replace(x=one.x - sigma[i] * normal[:, 0], y=one.y - sigma[i] * normal[:, 1])
        share[i] = (gap(case, moved, spread, np.full(4000, times[i])) < margin).mean()
    return share


def faults(case: Case, drive: Drive, people: Sequence[Person]) -> Iterator[str]:
    """Yield how a drive breaks the rule of contact, or of margins."""
    times = np.arange(drive.x.size) * DT
    for person in people:
        hypotheses = person.hypotheses
        uncertain = any(one.spread or one.growth for _, one in hypotheses)
        most = RISK + 0.02 * uncertain
        touching = sum(w * risk(case, drive, one, times, 0.0) for w, one in hypotheses) > most
        if touching.any():
            first = int(np.argmax(touching))
            rest = touching[first:]
            if not is_prefix(rest) or times[first] > SOON * uncertain:
                yield f"touches {person.name} at {times[touching][-1]:.2f} s"
            until = first + int(rest.sum())
            for _, one in hypotheses:
                x, y = (np.broadcast_to(column, times.shape) for column in one.at(times))
                later = Drive(*(column[1:] for column in drive))
                px, py = x[:-1] - later.x, y[:-1] - later.y
                still = Person(0, 0, radius=one.radius)
                own = gap(case, Drive(-px, -py, later.yaw, later.kind), still, times[1:])
                before = gap(case, drive._replace(x=drive.x - x, y=drive.y - y), still, times)[:-1]
                shrinks = (own - before)[: max(0, until - 1)]
                if np.isfinite(shrinks).all() and shrinks.clip(max=0).sum() < -3 * ROUNDED:
                    yield f"comes nearer to {person.name} in contact"
        near = sum(w * risk(case, drive, one, times, case.margin) for w, one in hypotheses) > most
        if case.margin and near.any():
            first = int(np.argmax(near))
            if times[near][-1] > LEAVING + PIECE + SLACK:
                yield f"leaves the margin of {person.name} only at {times[near][-1]:.2f} s"
            if not is_prefix(near[first:]) or times[first] > SOON:
                yield f"is within the margin of {person.name} at {times[near][-1]:.2f} s"


def sampled(trajectory: Trajectory) -> Drive:
    """Return a trajectory as it is driven, or executed."""
    states = trajectory.at(np.arange(0.0, trajectory.duration, DT))
    return Drive(states.x, states.y, states.yaw, np.full(states.x.size, "?"))


def stopped(case: Case, people: Sequence[Person], names: str) -> tuple[Person, ...]:
    """Return the people; those named stop 2 cm before the space that the robot needs at its start, or at once."""
    x, y = (case.robot.step * i for i in case.start[:2])
    reach = 0.1 if case.robot is not LONG else math.hypot(*CORNERS[0])
    found = []
    for person in people:
        if repr(person.name) in names and not person.futures:
            times = np.arange(0.0, 5.0, 0.01)
            px, py = person.at(times)
            need = reach + case.margin + case.stray + person.radius + 0.02 + 1.645 * person.deviation(times)
            near = np.hypot(px - x, py - y) < need
            comes = int(np.argmax(near & np.append(np.diff(np.hypot(px - x, py - y)) < 0, False)))
            before = np.flatnonzero(~near[:comes])
            person = replace(person, until=float(times[before[-1]]) if before.size else 0.0, afterwards="stays")
        found.append(person)
    return tuple(found)


def check(case: Case) -> Front:
    """Check a front against all plans of the grid."""
    problem, front = case.front()
    people = problem.world.content.people
    notes = [note for note in front.notes if "taken to stop" in note]
    if notes:
        people = stopped(case, people, notes[0])
    assert not verify(problem, front)
    priced = sorted(case.plans(), key=lambda plan: plan[0])
    possible = {tuple(np.round(row, 6)) for row, _ in priced}
    hypotheses = [one for person in people for _, one in person.hypotheses]
    best: list[tuple[float, ...]] = []
    for row, motions in priced:
        if any(all(a <= b for a, b in zip(other, row, strict=True)) for other in best):
            continue
        if is_safe(case, driven(case, motions), hypotheses):
            best.append(row)
            covered = (front.costs <= np.array(row) + 1e-6).all(axis=1).any()
            assert covered, (
                f"a safe plan is missing: {row}, {motions}; the front: {front.costs.tolist()}, {front.notes}"
            )
    for row, trajectory in zip(front.costs, front.trajectories, strict=True):
        own, missed = tuple(np.round(row[:3], 6)), row[3:]  # a wait may be a visit that its plan does not claim
        assert any(one[:3] == own and (np.array(one[3:]) >= missed).all() for one in possible), f"no plan costs {row}"
        others = [other for other in front.costs if (other <= row).all() and (other < row).any()]
        assert not others
        for way in (trajectory, trajectory.execution()):
            assert [*faults(case, sampled(way), people)] == []
        better = [other for other in best if (np.array(other) <= row).all() and (np.array(other) < row - 1e-6).any()]
        assert not better, f"{better} is better than {row}"
    return front


def person(x: float, y: float, vx: float = 0.0, vy: float = 0.0, until: float = 4.0, **others) -> Person:
    return Person(x, y, velocity=(vx, vy), until=until, **{"radius": 0.1, "name": "Ann", **others})


CASES = {
    "crosses": Case((person(0.8, 0.65, 0.0, -0.4),)),
    "crosses, without holds": Case((person(0.8, 0.65, 0.0, -0.4),), hold=None),
    "crosses with a margin": Case((person(0.8, 0.65, 0.0, -0.4),), margin=0.15),
    "comes against the robot": Case((person(1.4, 0.0, -0.4),), goal=(3, 1)),
    "comes slowly against the robot": Case((person(0.5, 0.0, -0.15),)),
    "comes slowly, with a margin": Case((person(0.6, 0.0, -0.15),), margin=0.2),
    "stands in the way for a while": Case((person(0.8, 0.0, until=3.0),)),
    "stands with an overlap": Case((person(-0.18, 0.0, until=3.0),)),
    "stands ahead with an overlap": Case((person(0.18, 0.02, until=3.0),)),
    "stands beside with an overlap, and walks on": Case((person(0.0, 0.18, 0.3, 0.0),)),
    "walks off in a chance of contact, and is gone": Case(
        (
            person(0.8941, 0.5977, 0.2792, 0.1098, 3.7284, growth=0.05, name="Bob", afterwards="stays"),
            person(0.3083, 0.2917, -0.0121, -0.0993, 0.8802, spread=0.05),
        ),
        margin=0.15,
        start=(1, 1, 0),
    ),
    "stands in the margin": Case((person(0.0, 0.3, until=3.0),), margin=0.25),
    "walks up and stays in the margin": Case((person(0.0, 0.6, 0.0, -0.3, until=0.6, afterwards="stays"),), margin=0.3),
    "stays for good where a slow robot starts": Case(
        (person(0.54, -0.25, 0.1, until=0.6, afterwards="stays"),), SLOW, 0.5, None, (0, 0, 0), (4, 2), (5, 3), 92
    ),
    "is uncertain, and crosses": Case((person(0.8, 0.65, 0.0, -0.4, spread=0.03, growth=0.03),)),
    "stands with a chance of contact": Case((person(0.25, 0.0, until=3.0, spread=0.05),)),
    "stands behind with a chance of contact": Case((person(-0.23, 0.0, until=3.0, spread=0.05),)),
    "stands with a chance of contact that grows": Case((person(0.0, 0.32, until=3.0, spread=0.02, growth=0.1),)),
    "walks away with a chance of contact": Case((person(0.25, 0.0, 0.3, 0.0, spread=0.05),)),
    "crosses a long robot": Case((person(0.8, 0.65, 0.0, -0.4),), LONG),
    "walks beside a long robot": Case((person(0.1, 0.22, 0.2, 0.0),), LONG, size=(4, 1)),
    "stands behind a long robot": Case((person(-0.26, 0.0, until=3.0),), LONG),
    "stands behind a long robot with a chance of contact": Case((person(-0.3, 0.0, until=3.0, spread=0.05),), LONG),
    "two walk": Case((person(0.8, 0.65, 0.0, -0.3), person(1.4, 0.4, -0.3, 0.0, name="Bob"))),
    "walks on or stands": Case(
        (Person(0.8, 0.5, radius=0.1, name="Ann", until=4.0, futures=(Future(3, velocity=(0, -0.3)), Future(1))),)
    ),
}
FEW = (
    "crosses with a margin",
    "stands with an overlap",
    "stays for good where a slow robot starts",
    "walks off in a chance of contact, and is gone",
    "stands behind a long robot",
)


@pytest.mark.cases(*FEW)
@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in CASES.items()])
def test_a_front_among_people_is_that_of_all_plans(case: Case) -> None:
    assert len(check(case))


def some_case(seed: int) -> Case:
    """Return one or two people who stand or walk about the start of a robot."""
    rng = np.random.default_rng(seed)
    people = []
    for name in ("Ann", "Bob")[: int(rng.integers(1, 3))]:
        x, y = rng.uniform(-0.25, 1.4), rng.uniform(-0.25, 0.65)
        speed, angle = rng.choice([0.0, 0.1, 0.3, 0.6]), rng.uniform(0, 2 * math.pi)
        velocity = (speed * math.cos(angle), speed * math.sin(angle))
        spread, growth = rng.choice([0.0, 0.0, 0.05]), rng.choice([0.0, 0.0, 0.05])
        until, then = rng.uniform(0.5, 4.0), rng.choice(["gone", "stays"])
        others = {"spread": float(spread), "growth": float(growth), "afterwards": str(then)}
        people.append(person(float(x), float(y), *map(float, velocity), float(until), name=name, **others))
    if not any(one.moves for one in people):
        people[0] = replace(people[0], afterwards="gone")
    goal = (1.2, 0.0)  # who stands there for good makes it unusable
    people = [replace(one, afterwards="gone") if math.dist((one.x, one.y), goal) < 0.5 else one for one in people]
    robot = ROUND if rng.random() < 0.7 else LONG
    start = (int(rng.integers(0, 2)), int(rng.integers(0, 2)), int(rng.integers(0, 4)))
    return Case(tuple(people), robot, float(rng.choice([0.0, 0.0, 0.15])), rng.choice([1.0, None]), start)


@pytest.mark.seeds(1, of=200)
def test_a_front_among_any_people_is_that_of_all_plans(seed: int) -> None:
    case = some_case(seed)
    stands = driven(case, [])
    touching = min(gap(case, stands, one, np.zeros(stands.x.size))[0] for one in case.people)
    if case.robot is LONG and touching < 0:
        with pytest.raises(QueryError, match="overlaps the robot's outline"):
            case.front()
    else:
        check(case)
