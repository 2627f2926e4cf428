"""Robot model "ackermann": a car-like base, such as a shuttle, whose front wheels steer within limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import LEAST, MOST, Angle, set_reals
from hpop.base.text import is_number, shown
from hpop.errors import ModelError
from hpop.models.ackermann.laws import (
    ArcRamp,
    CircularArc,
    Clothoid,
    ClothoidRamp,
    SteeredGeometry,
    rest_to_rest_ends,
)
from hpop.models.ackermann.words import MOST as LETTERS
from hpop.models.ackermann.words import Word, composed, dubins, reeds_shepp
from hpop.models.base import PlanarModel, model, plane_space
from hpop.models.collision import Part, convex_parts, notes_on_seat
from hpop.models.differential_drive import LONGEST, SLOWEST, checked_footprint, checked_offset
from hpop.models.ramps import doubtful_ramps, ramp_faults
from hpop.models.rigid import FieldOfView, Mount, Position, checked_field_of_view, checked_seat
from hpop.motions import HOLD, Law, Leg, States, StateSpace, laws_of
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK, PACE
from hpop.trajectories.trajectory import Trajectory

STEEPEST = 1.5  # rad: largest steering angle that an option may have
HEADINGS = 32  # headings that are tried where the goal leaves the heading free
MOST_ARC = 3.0  # rad: longer arcs are cut, so that no motion turns by more than half a turn
CLOSE = 1e-6  # relative tolerance of limits
ROUNDED = 1e-13  # m: largest rounding error of a position
JUMP = 1e-4  # rad: smallest change of the steering angle that counts as a jump


@model("ackermann")
@dataclass(frozen=True)
class Ackermann(PlanarModel):
    """Car-like base that steers by its front wheels; states x, y (m) of the middle of its rear axle, and yaw (rad).

    wheelbase       m      distance between the axles
    steering        rad    largest steering angle δ; the smallest radius is wheelbase/tan δ
    steering_rate   rad/s  largest rate of the steering angle; None if the wheels take any angle at once
    speed           m/s    cruise speed forwards
    reverse_speed   m/s    cruise speed backwards; 0 for a base that only goes forwards
    acceleration    m/s²   along the path
    footprint       m      corners ((x, y), ...) of a polygon that contains the middle of the rear axle, (0, 0), x ahead
    body_height     m      top of the body above the floor
    camera_height   m      of the camera above the floor
    camera_offset   m      of the camera from the middle of the rear axle, (ahead, left)
    field_of_view   rad    angles of view (h, v); None for all round
    seat            m      position (ahead, left, height) of a passenger's seat, for the criteria of felt motion; None
                           for no seat

    Motions are arcs, which include straight moves, and clothoids (:mod:`hpop.models.ackermann.laws`). Two states are
    joined by the shortest path of arcs and straight moves: a word of Reeds and Shepp or, for a base that only goes
    forwards, of Dubins. With a ``steering_rate`` the car stands while it steers from arc to arc. The planner
    ``exact: {on: primitives}`` plans clothoids, on which it steers while it drives.
    """

    executed: ClassVar[Mapping[str, str]] = {"arc": "arc_ramp", "clothoid": "clothoid_ramp"}

    wheelbase: float = 0.8
    steering: Angle = 0.6
    steering_rate: float | None = 0.8
    speed: float = 1.0
    reverse_speed: float = 0.5
    acceleration: float = 1.0
    footprint: tuple[tuple[float, float], ...] = ((1.0, 0.3), (-0.2, 0.3), (-0.2, -0.3), (1.0, -0.3))
    body_height: float = 1.3
    camera_height: float = 1.2
    camera_offset: tuple[float, float] = (0.4, 0.0)
    field_of_view: FieldOfView | None = None
    seat: Position | None = None

    def __post_init__(self) -> None:
        lengths, rates = ("wheelbase", "body_height", "camera_height"), ("speed", "acceleration")
        set_reals(self, *lengths, least=LEAST, most=LONGEST, kind="a positive length in m", error=ModelError)
        set_reals(self, *rates, least=SLOWEST, most=MOST, kind="a positive number", error=ModelError)
        if is_number(self.steering) and STEEPEST < self.steering < 90:
            raise ModelError(
                f"steering must be an angle in rad up to {STEEPEST}, got {shown(self.steering)}; {self.steering:g} "
                f"degrees are {math.radians(self.steering):.3g} rad, in a scenario '{self.steering:g} deg'"
            )
        set_reals(self, "steering", least=SLOWEST, most=STEEPEST, kind="an angle in rad", error=ModelError)
        set_reals(
            self, "reverse_speed", least=0.0, most=self.speed, kind="a speed in m/s up to speed", error=ModelError
        )
        if self.steering_rate is not None:
            set_reals(self, "steering_rate", least=SLOWEST, most=MOST, kind="None, or rad/s", error=ModelError)
        for name in (*lengths, *rates, "steering", "reverse_speed"):
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "field_of_view", checked_field_of_view(self.field_of_view))
        object.__setattr__(self, "camera_offset", checked_offset(self.camera_offset))
        object.__setattr__(self, "seat", checked_seat(self.seat))
        object.__setattr__(self, "footprint", checked_footprint(self.footprint))

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: those of every planar model, "steering", and "heading" if the base only goes forwards."""
        return super().provides | {"steering", *(() if self.reverse_speed else ("heading",))}

    @property
    def radius(self) -> float:
        """Smallest radius, m, on which the middle of the rear axle can drive."""
        return self.wheelbase / math.tan(self.steering)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remark on a seat beside the footprint."""
        return notes_on_seat(self.seat, self.parts)

    def notes_on(self, trajectories: Sequence[Trajectory]) -> tuple[str, ...]:
        """Return a remark on what planned durations leave out, if a plan reverses."""
        note = "planned durations leave out stops where a car reverses its direction; its execution has them"
        return (note,) if any(self._reverses(each) for each in trajectories) else ()

    def _reverses(self, planned: Trajectory) -> bool:
        """Return whether a plan, which is not an execution, goes both forwards and backwards."""
        lengths = _lengths(self, planned)
        return not {*planned.kinds} & {*self.executed.values()} and lengths.min() < 0 < lengths.max()

    @cached_property
    def space(self) -> StateSpace:
        """State space of x, y and yaw; in distances a radian counts as the smallest arc that turns by it."""
        return plane_space(self.radius)

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by kind: planned ("arc", "clothoid") and executed ("arc_ramp", "clothoid_ramp")."""
        speeds, rate = (self.speed, self.reverse_speed), self.steering_rate
        return {
            "arc": CircularArc(*speeds, self.wheelbase, rate, 0.0 if rate is None else self.speed / self.acceleration),
            "clothoid": Clothoid(*speeds),
            "arc_ramp": ArcRamp(self.speed, self.acceleration),
            "clothoid_ramp": ClothoidRamp(self.speed, self.acceleration),
        }

    @cached_property
    def mounts(self) -> Mapping[str, Mount]:
        """Positions of the bodies "base", "camera" and, if there is one, "seat"."""
        seat = {"seat": Mount(*self.seat)} if self.seat else {}
        return {"base": Mount(), "camera": Mount(*self.camera_offset, self.camera_height), **seat}

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Collision geometry: the body."""
        return convex_parts(self.footprint, 0.0, self.body_height)

    def path(self, a: States, b: States) -> Word:
        """Return the shortest paths between states (M,), as words with lengths in radii.

        Where a yaw of b is NaN, it is the one of 32 headings with the shortest path.
        """
        dx, dy = (b.x - a.x) / self.radius, (b.y - a.y) / self.radius
        x, y = dx * np.cos(a.yaw) + dy * np.sin(a.yaw), dy * np.cos(a.yaw) - dx * np.sin(a.yaw)
        shortest = reeds_shepp if self.reverse_speed else dubins
        yaw = np.broadcast_to(b.yaw - a.yaw, x.shape)
        free = np.flatnonzero(np.isnan(yaw))
        found = shortest(x, y, np.nan_to_num(yaw))
        if free.size:
            turns = np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False)
            tried = shortest(np.repeat(x[free], HEADINGS), np.repeat(y[free], HEADINGS), np.tile(turns, free.size))
            best = tried.total.reshape(-1, HEADINGS).argmin(axis=1) + HEADINGS * np.arange(free.size)
            for column, chosen in zip(found, tried, strict=True):
                column[free] = chosen[best]
        return found

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the arcs and straight moves of the shortest paths from states a (M,) to b (M,)."""
        word = self.path(a, b)
        count = 2 if self.reverse_speed else 3  # pieces of an arc; words with motions backwards have arcs up to pi
        turned = np.abs(word.curvature * word.length)
        pieces = np.clip(np.ceil(turned / MOST_ARC), 1, count)
        share = (np.arange(count) < pieces[..., None]) / pieces[..., None]  # (M, 5, count)
        length = (word.length[..., None] * share).reshape(-1, LETTERS * count)
        curvature = np.repeat(word.curvature, count, axis=1)
        x, y, turn = composed(curvature, length)
        cos, sin = np.cos(a.yaw)[:, None], np.sin(a.yaw)[:, None]
        place = a.x[:, None] + self.radius * (x * cos - y * sin), a.y[:, None] + self.radius * (x * sin + y * cos)
        exact = [np.isfinite(b.x), np.isfinite(b.y), np.isfinite(b.yaw)]
        legs = []
        moves = np.abs(length) > 0
        last = np.where(moves.any(axis=1), length.shape[1] - 1 - np.argmax(moves[:, ::-1], axis=1), -1)
        for i in range(length.shape[1]):
            ends = place[0][:, i + 1], place[1][:, i + 1], a.yaw + turn[:, i + 1]
            arrived = (i >= last) & (last >= 0)
            goal = b.x, b.y, ends[2] + np.angle(np.exp(1j * (b.yaw - ends[2])))
            columns = (
                np.where(arrived & known, there, end) for known, there, end in zip(exact, goal, ends, strict=True)
            )
            legs.append(Leg("arc", States(**dict(zip(self.space.names, columns, strict=True))), moves[:, i]))
        return legs

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return what the car really drives, and the times (n+1,), s, at which it passes the planned states.

        The car drives runs from rest to rest. It stops where it reverses, at holds, and where it must steer before it
        can go on; there it stands for the change of the steering angle divided by the steering rate. If the plan must
        keep its times (``punctual``), each run lies in the middle of its planned time, or as soon after as possible.
        """
        return _executed(self, trajectory)

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each kind of fault: too sharp, backwards, too fast in steering or speed, a steering jump."""
        yield from super().faults(trajectory)
        yield from ramp_faults(trajectory)
        kinds = np.array(trajectory.kinds, dtype=object)
        for kind in dict.fromkeys(trajectory.kinds):
            law, rows = laws_of(self)[kind], np.flatnonzero(kinds == kind)
            if isinstance(law, SteeredGeometry):
                start, end = trajectory.states.take(rows), trajectory.states.take(rows + 1)
                for fault, wrong in self._wrong(law, start, end).items():
                    if wrong.any():
                        yield f"{fault} in motion {rows[np.argmax(wrong)]}, a {kind}"
        yield from self._jumps(trajectory)

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of motions that :meth:`faults` must check.

        These are all clothoids, all speed ramps, and arcs that exceed the car's limits of curvature, speed or steering
        rate, or that reverse although the car cannot.
        """
        found = super().doubtful(law, start, end) | doubtful_ramps(law, start, end)
        if not isinstance(law, SteeredGeometry):
            return found
        if law.kind != "arc":
            return np.ones(start.size, dtype=np.bool_)
        return np.asarray(np.logical_or.reduce([found, *self._wrong(law, start, end).values()]))

    def _wrong(self, law: SteeredGeometry, start: States, end: States) -> dict[str, BoolArray]:
        """Return masks (M,) of the motions with each kind of fault, by its text."""
        shape = law.shape(start, end)
        bends = [np.abs(shape.curvature(share)) for share in (0.0, 1.0)]
        sharpest, noise = np.maximum(*bends), _noise(shape.length)
        fault = {
            "bends more sharply than its steering allows": sharpest * self.radius > 1.0 + CLOSE + noise * self.radius,
            "goes backwards": (shape.length < -CLOSE) & (self.reverse_speed == 0.0),
        }
        fastest = top = np.where(shape.length < 0, self.reverse_speed, self.speed)
        if PACE in law.extra:
            fastest = self.speed * np.maximum(start.pace, end.pace)
            fault["drives faster than its speed in this direction"] = fastest > top * (1.0 + CLOSE)
        if self.steering_rate is not None:
            straightest = np.where(np.abs(shape.bend) >= np.abs(shape.turn), 0.0, np.minimum(*bends))
            rate = self.wheelbase * np.abs(shape.sharpness) * fastest / (1.0 + (self.wheelbase * straightest) ** 2)
            slack = self.wheelbase * fastest * noise / np.maximum(np.abs(shape.length), LEAST)
            fault["steers faster than its steering rate"] = rate > self.steering_rate * (1.0 + CLOSE) + slack
        return {text: np.asarray(wrong) for text, wrong in fault.items()}

    def _jumps(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for the first state that the car passes at speed although its steering angle jumps there."""
        if self.steering_rate is None:
            return
        angles, noise = self.steering_angles(trajectory), self.wheelbase * _noise(_lengths(self, trajectory))
        pace = getattr(trajectory.states, PACE, np.ones(len(trajectory) + 1))
        kinds, drives = trajectory.kinds, [PACE in laws_of(self)[kind].extra for kind in trajectory.kinds]
        for i in range(1, len(trajectory)):
            moves = bool(pace[i] > 0) if drives[i] else kinds[i - 1] == kinds[i] == "clothoid"
            jump = abs(angles[1][i - 1] - angles[0][i])
            if moves and jump > JUMP + noise[i - 1] + noise[i] and HOLD.kind not in kinds[i - 1 : i + 1]:
                yield f"passes state {i} at speed, although its steering angle jumps there"
                return

    def steering_angles(self, trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return the steering angles, rad, at the start and at the end of each motion (n,); 0 in holds."""
        found = np.zeros((2, len(trajectory)))
        kinds = np.array(trajectory.kinds, dtype=object)
        for kind in dict.fromkeys(trajectory.kinds):
            law, rows = laws_of(self)[kind], np.flatnonzero(kinds == kind)
            if isinstance(law, SteeredGeometry):
                shape = law.shape(trajectory.states.take(rows), trajectory.states.take(rows + 1))
                for side, share in enumerate((0.0, 1.0)):
                    found[side, rows] = np.arctan(self.wheelbase * shape.curvature(share))
        return found[0], found[1]


def _noise(length: FloatArray) -> FloatArray:
    """Return by how much (N,), 1/m, rounding of the poses may change the curvature of motions of some lengths, m."""
    return ROUNDED / np.maximum(length * length, ROUNDED)


def _executed(robot: Ackermann, planned: Trajectory) -> tuple[Trajectory, FloatArray]:
    """Return the execution of a plan, and the times (n+1,), s, at which it passes the planned states."""
    if not set(planned.kinds) & robot.executed.keys():
        return planned, planned.times
    names, laws, states = robot.space.names, laws_of(robot), planned.states
    lengths, angles, passed = _lengths(robot, planned), robot.steering_angles(planned), np.zeros(len(planned) + 1)
    rows, kinds = [(*(float(getattr(states, name)[0]) for name in names), 0.0, 0.0)], list[str]()
    now, clock, first, times = 0.0, 0.0, 0, planned.times
    angle = stood = 0.0  # rad, of the front wheels; s, for which the car has stood with them
    while first < len(planned):
        last = _run_end(robot, planned, lengths, angles, first)
        way = np.append(0.0, np.cumsum(np.abs(lengths[first:last])))
        top = robot.speed if lengths[first:last].sum() >= 0 else robot.reverse_speed
        profile = rest_to_rest_ends(float(way[-1]), top, robot.acceleration)
        stands = planned.kinds[first] == HOLD.kind
        if stands and planned.punctual and last < len(planned):
            wait = 0.0  # the next run begins when it must
        elif stands:
            wait = float(times[last]) - now if planned.punctual else float(np.diff(states.clock)[first])
            stood += wait
        else:
            turned = abs(angles[0][first] - angle)
            wait = 0.0 if robot.steering_rate is None else turned / robot.steering_rate - stood
            angle, stood = angles[1][last - 1], 0.0
            if planned.punctual:
                steps = np.diff(profile, axis=0)[:, 0], profile[:-1, 1] + profile[1:, 1]
                lasts = float((2.0 * steps[0] / np.maximum(steps[1], LEAST)).sum())
                wait = max(wait, 0.5 * float(times[first] + times[last] - lasts) - now, 0.0)
                passed[: first + 1] = np.minimum(passed[: first + 1], now + wait)
        if wait > LEAST or (stands and not planned.punctual):
            now, clock = now + wait, clock + wait
            rows.append((*rows[-1][:3], 0.0, clock))
            kinds.append(HOLD.kind)
        at, speed, near = 0.0, 0.0, min(LEAST, 1e-3 * float(way[-1]))
        for i, (begin, end) in enumerate(pairwise(way.tolist()), first):
            inside = profile[(profile[:, 0] > begin + near) & (profile[:, 0] < end - near), 0].tolist()
            motion, law = (states.take([i]), states.take([i + 1])), laws[planned.kinds[i]]
            for stop in [*inside, end] if end - begin > LEAST else []:
                share = np.array([(stop - begin) / (end - begin)])
                here = motion[1] if stop == end else None
                pose = (
                    float((law.interpolate(name, *motion, share) if here is None else getattr(here, name))[0])
                    for name in names
                )
                faster = float(np.sqrt(np.interp(stop, profile[:, 0], profile[:, 1] ** 2)))
                now += 2.0 * (stop - at) / (speed + faster)
                at, speed = stop, faster
                rows.append((*pose, speed / robot.speed, clock))
                kinds.append(robot.executed[planned.kinds[i]])
            passed[i + 1] = max(now, float(times[i + 1])) if stands and planned.punctual else now
        first = last
    columns = dict(zip((*names, PACE, CLOCK), np.array(rows).T, strict=True))
    wanted = (*names, *extras(planned.model, kinds))
    return Trajectory(planned.model, States(**{name: columns[name] for name in wanted}), tuple(kinds)), passed


def _run_end(
    robot: Ackermann, planned: Trajectory, lengths: FloatArray, angles: tuple[FloatArray, FloatArray], first: int
) -> int:
    """Return the index after the last motion of the run, from rest to rest, that begins with motion ``first``.

    A run ends before a hold, a reversal, and a jump of the steering angle. A hold is a run of its own. A plan that must
    keep its times stops before each arc with turned wheels: the parts of a long arc are runs of their own then.
    """
    last, way = first + 1, lengths[first]  # the last length other than 0
    if planned.kinds[first] == HOLD.kind:
        return last
    while last < len(planned) and planned.kinds[last] != HOLD.kind:
        if lengths[last] * way < 0:
            break
        way = lengths[last] or way
        if robot.steering_rate is not None and abs(angles[0][last] - angles[1][last - 1]) > JUMP:
            break
        stops = planned.punctual and robot.steering_rate is not None and abs(angles[0][last]) > JUMP
        if stops and planned.kinds[last - 1 : last + 1] == ("arc", "arc"):
            break
        last += 1
    return last


def _lengths(robot: Ackermann, planned: Trajectory) -> FloatArray:
    """Return the signed length (n,), m, of each motion; 0 for holds."""
    lengths = np.zeros(len(planned))
    kinds = np.array(planned.kinds, dtype=object)
    for kind in dict.fromkeys(planned.kinds):
        law, rows = laws_of(robot)[kind], np.flatnonzero(kinds == kind)
        if isinstance(law, SteeredGeometry):
            lengths[rows] = law.shape(planned.states.take(rows), planned.states.take(rows + 1)).length
    return lengths
