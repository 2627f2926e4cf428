"""Simulation of drives: a law that tracks a plan, a base with delay, slip and localisation noise, and people.

Here is the simulation of one drive: the true motion, contacts, the distance from the plan, and driven costs.

The robot follows the plan by :class:`hpop.simulation.Tracker`. It brakes where going on would bring it too near to a
person, judged by the velocities of the people, and goes on when the way is free. It keeps to its plan; to let a robot
change its plan on the way, see :func:`hpop.follow`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import real, whole
from hpop.errors import OptionError
from hpop.models.driven import Drive
from hpop.motions import Model, States, is_curve
from hpop.problems.front import Front, chosen_point
from hpop.problems.problem import Problem
from hpop.simulation.people import Crowd, Pedestrians, TrackedPeople, Walking
from hpop.simulation.tracking import Command, DriveLimits, Tracker
from hpop.trajectories.contacts import distance_to_outline
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, Track

__all__ = [
    "Command",
    "Crowd",
    "DriveLimits",
    "Pedestrians",
    "SimulatedBase",
    "Simulation",
    "TrackedPeople",
    "Tracker",
    "Walking",
    "farthest_off",
    "simulate",
]

NOISE_LEVER = 1.0  # m: noise of the measured yaw is the noise of positions over this distance
SLIP_LASTS = 1.0  # s between random values of the slip, which changes linearly from one to the next
Pose2 = tuple[float, float, float]


class SimulatedBase:
    """Base that follows velocity commands; poses are (x m, y m, yaw rad) in the frame of the world.

    model  robot; only the distance between its wheels is used
    pose   true pose at time 0
    delay  s, after which a command takes effect. The next step of :meth:`advance` changes the velocity to it, linearly
    slip   0 to 0.5, largest share by which a wheel drives less far than it turns; drawn for each wheel every second
    noise  m, radius of the disc about the true position in which measured positions lie; yaws are off by up to as many
           radians as this is metres
    seed   of all random numbers: equal seeds give equal drives
    """

    def __init__(
        self, model: Model, pose: Pose2, delay: float = 0.0, slip: float = 0.0, noise: float = 0.0, seed: int = 0
    ) -> None:
        self.delay = float(real("delay", delay, 0.0, 1.0, "a time in s"))
        self.slip = float(real("slip", slip, 0.0, 0.5, "a share of the wheels' motion"))
        self.noise = float(real("noise", noise, 0.0, 1.0, "a distance in m"))
        self._half = 0.5 * DriveLimits.of(model).wheel_base
        self._slips, self._noises = np.random.default_rng(whole("seed", seed, 0, 2**31, "a number")).spawn(2)
        self._knots = [self._slips.uniform(0.0, self.slip, 2) for _ in range(2)]
        self._waiting = deque[tuple[float, Command]]()
        self._in_effect, self._wheels = Command(0.0, 0.0), Command(0.0, 0.0)
        self._time = 0.0
        self.velocity = Command(0.0, 0.0)
        """True speed, m/s, and turn rate, rad/s."""
        self.pose: Pose2 = (float(pose[0]), float(pose[1]), float(pose[2]))
        """True pose."""
        self.measured: Pose2 = self._measure()
        """Measured pose."""

    def command(self, v: float, w: float, t: float) -> None:
        """Send a command at time ``t``, s: speed, m/s, and turn rate, rad/s."""
        self._waiting.append((t + self.delay, Command(float(v), float(w))))

    def advance(self, t: float) -> None:
        """Move on to time ``t``, s: one step, in which speeds change linearly to those of the command in effect."""
        step = t - self._time
        if step <= 0.0:
            return
        while self._waiting and self._waiting[0][0] <= self._time + 1e-9:
            self._in_effect = self._waiting.popleft()[1]
        self._time = t
        while len(self._knots) < t / SLIP_LASTS + 2:
            self._knots.append(self._slips.uniform(0.0, self.slip, 2))
        before, self.velocity = self.velocity, self._slipping(self._in_effect, t)
        x, y, yaw = self.pose
        gain, turn_gain = self.velocity.v - before.v, self.velocity.w - before.w
        for share, weight in ((0.5 - math.sqrt(0.15), 5.0), (0.5, 8.0), (0.5 + math.sqrt(0.15), 5.0)):  # Gauss-Legendre
            way = step * weight / 18.0 * (before.v + share * gain)
            along = yaw + step * share * (before.w + 0.5 * share * turn_gain)
            x, y = x + way * math.cos(along), y + way * math.sin(along)
        self.pose = (x, y, yaw + step * (before.w + 0.5 * turn_gain))
        self.measured = self._measure()

    def _slipping(self, command: Command, t: float) -> Command:
        """Return the true speed and turn rate at time ``t``, s, if the wheels turn as commanded but slip."""
        number, share = divmod(t / SLIP_LASTS, 1.0)
        slip: FloatArray = (1.0 - share) * self._knots[int(number)] + share * self._knots[int(number) + 1]
        if not self._half:
            return Command(command.v * (1.0 - slip[0]), command.w * (1.0 - slip[0]))
        left = (command.v - self._half * command.w) * (1.0 - slip[0])
        right = (command.v + self._half * command.w) * (1.0 - slip[1])
        return Command(0.5 * float(left + right), 0.5 * float(right - left) / self._half)

    def _measure(self) -> Pose2:
        """Return a measured pose: its position is uniform in a disc about the true one, its yaw in an interval."""
        area, angle, turned = self._noises.uniform(size=3).tolist()
        off, along = self.noise * math.sqrt(area), math.tau * angle
        x, y, yaw = self.pose
        wrong = self.noise / NOISE_LEVER * (2.0 * turned - 1.0)
        return (x + off * math.cos(along), y + off * math.sin(along), yaw + wrong)


GUARD = 0.15  # m: a robot brakes where it would come nearer to a person
LOOKS = 0.1  # s between looks at the people, and between the moments of a look ahead
BEYOND = 0.4  # s that a look ahead is longer than braking takes
TRIES = 3.0  # durations of the plan after which a simulation ends, beside PATIENCE
PATIENCE = 20.0  # s
KEEPS = 0.1  # m between the surfaces of the robot and a person who waits before it


def farthest_off(limits: DriveLimits, delay: float = 0.0, slip: float = 0.0, noise: float = 0.0) -> float:
    """Return the largest distance, m, that is expected between a simulated robot and the pose where it should be.

    The formula was chosen from simulations and is tested in 300 random rooms; it is not proved. If you plan for a robot
    whose body is larger by this distance, the real one should touch nothing that stands.

    limits  of the base
    delay   s, after which a command takes effect
    slip    largest share by which a wheel drives less far than it turns
    noise   m, largest error of measured positions
    """
    return limits.speed * (0.06 + 0.2 * delay + 1.2 * slip) + noise


@dataclass(frozen=True, eq=False, repr=False)
class Simulation:
    """One simulated drive.

    times     (N,)       s, from 0
    poses     (N, 3)     true poses: x m, y m, yaw rad
    measured  (N, 3)     measured poses: x m, y m, yaw rad
    commands  (N, 2)     speed m/s and turn rate rad/s
    people    (N, P, 4)  x m, y m, vx m/s, vy m/s; NaN for a person who is absent
    radius    m, of each person; the largest one, if they differ
    off       (N,)       m, distance from the pose of the plan at which the robot should be
    bound     m, bound of ``off`` that was expected before the drive (:func:`farthest_off`)
    late      s, largest time by which the robot was behind its plan
    braked    s, during which it braked or stood because of people
    contacts  sentences: the first contact with an obstacle, and with each person; empty if the robot touched nothing
    arrived   whether the plan was driven to its end
    planned   costs of the plan by criterion
    driven    costs of the true motion by criterion, among the people as they walked; empty if the robot has joints
    """

    times: FloatArray
    poses: FloatArray
    measured: FloatArray
    commands: FloatArray
    people: FloatArray
    radius: float
    off: FloatArray
    bound: float
    late: float
    braked: float
    contacts: tuple[str, ...]
    arrived: bool
    planned: Mapping[str, float]
    driven: Mapping[str, float]

    @property
    def farthest(self) -> float:
        """Largest distance from the plan, m."""
        return float(self.off.max())

    def __repr__(self) -> str:
        ends = "arrived" if self.arrived else "did not arrive"
        return (
            f"<Simulation: {ends} after {self.times[-1]:.1f} s, {len(self.contacts)} contacts, at most "
            f"{self.farthest:.3f} m off the plan (bound {self.bound:.3f} m), {self.late:.1f} s late>"
        )


@checked_arguments
def simulate(
    problem: Problem,
    plan: Front | Trajectory,
    choice: Any = "knee",
    *,
    robot: Model | None = None,
    people: Any = None,
    dt: float = 0.02,
    **disturbances: Any,
) -> Simulation:
    """Simulate one drive along a plan, and return what happened.

    The simulation ends when the plan is driven, or after 3 times its duration plus 20 s, as when a person stays in the
    way.

    Parameters
    ----------
    problem : the problem of the plan
    plan : a front, of which one point is driven, or a trajectory
    choice : a point of the front, its row, or its name, such as "knee"
    robot : the robot that drives; default: the one of the plan. A plan for a robot that is slightly larger and slower
        leaves room for errors, and lets the real robot make up for slip
    people : list of :class:`hpop.world.Person`, or an object that moves people (:class:`hpop.simulation.Pedestrians`),
        such as :class:`hpop.simulation.Crowd`; default: the people of the problem, who wait before the robot
    dt : s, time between commands
    disturbances : ``delay`` s, ``slip``, ``noise`` m and ``seed`` of :class:`hpop.simulation.SimulatedBase`

    Raises OptionError for invalid values, ModelError for a robot that does not drive on wheels or in the plane.
    """
    trajectory = plan if isinstance(plan, Trajectory) else chosen_point(plan, choice).trajectory
    dt = real("dt", dt, 0.001, 0.2, "a time in s")
    if unknown := sorted({*disturbances} - {"delay", "slip", "noise", "seed"}):
        raise OptionError(f"disturbances are delay, slip, noise and seed, got {', '.join(unknown)}; leave it out")
    robot = robot or problem.model
    drive = _Drive(problem, trajectory, robot, _pedestrians(people, problem, robot), disturbances)
    longest = TRIES * drive.tracker.duration + PATIENCE
    while drive.time < longest and not drive.finished:
        drive.step(dt)
    return drive.told()


def _pedestrians(people: Any, problem: Problem, robot: Model) -> Pedestrians:
    """Return the object that moves the people."""
    if people is not None and hasattr(people, "advance"):
        moving: Pedestrians = people
        return moving
    given = list(problem.world.content.people if people is None else people)
    if wrong := [person for person in given if not isinstance(person, Person)]:
        raise OptionError(
            f"people must be hpop.world.Person, or one object with advance(t, robot_pose), got {wrong[0]!r:.80}"
        )
    radius = max((person.radius for person in given), default=0.0)
    return TrackedPeople(given, _reach(robot) + radius + KEEPS)


def _reach(robot: Model) -> float:
    return max((float(part.reach) for part in robot.platform), default=0.0)


class _Drive:
    """A simulated drive up to its present time, s."""

    def __init__(
        self,
        problem: Problem,
        trajectory: Trajectory,
        robot: Model,
        people: Pedestrians,
        disturbances: Mapping[str, Any],
    ) -> None:
        self.problem, self.trajectory, self.robot, self.people = problem, trajectory, robot, people
        x, y, yaw = (float(getattr(trajectory.states, name)[0]) for name in ("x", "y", "yaw"))
        self.base = SimulatedBase(robot, (x, y, yaw), **disturbances)
        self.limits = DriveLimits.of(robot)
        self.tracker = Tracker(trajectory, limits=self.limits, delay=self.base.delay)
        self.time, self.late, self.braked, self.looked = 0.0, 0.0, 0.0, -math.inf
        self.rows: list[tuple[Any, ...]] = []
        self._note(Command(0.0, 0.0))

    @property
    def finished(self) -> bool:
        """True once the plan is driven and the base stands."""
        return self.tracker.finished(self.time) and max(map(abs, self.base.velocity)) < 1e-3

    def step(self, dt: float) -> None:
        """Command, and move on by ``dt`` s."""
        if self.time - self.looked >= LOOKS - 1e-9:
            self.looked = self.time
            (self.tracker.stop if self._must_brake() else self.tracker.go)()
        self.braked += dt * self.tracker.stopping
        command = self.tracker.command(self.time, self.base.measured)
        self.base.command(*command, self.time)
        self.time += dt
        self.base.advance(self.time)
        self._note(command)

    def _note(self, command: Command) -> None:
        self.walking = self.people.advance(self.time, self.base.pose)
        self.late = max(self.late, self.tracker.late)
        off = self.tracker.off(self.time, self.base.pose)
        self.rows.append(
            (self.time, self.base.pose, self.base.measured, command, self.base.velocity, self.walking, off)
        )

    def _must_brake(self) -> bool:
        """Return whether going on would bring the robot within `GUARD` m of a person, and nearer than braking would."""
        walking = np.array([one for one in self.walking if not math.isnan(one[0])], float).reshape(-1, 4)
        if not len(walking):
            return False
        speed = max(abs(self.base.velocity.v), abs(self.tracker.feed.v))
        brakes = speed / self.limits.acceleration
        after = np.arange(0.0, brakes + self.base.delay + BEYOND, LOOKS)
        here = np.array(self.base.measured[:2])
        clock = self.tracker.clock(self.time)
        begin = np.array(self.tracker.at(clock)[:2])
        gaps = []
        for until in (after, np.minimum(after, 0.5 * brakes + self.base.delay * (speed > 0.0))):
            place = here + np.array([self.tracker.at(clock + moment)[:2] for moment in until]) - begin
            there = walking[:, None, :2] + after[None, :, None] * walking[:, None, 2:]
            apart = np.hypot(*np.moveaxis(there - place[None], 2, 0)) - _reach(self.robot) - self.people.radius
            gaps.append(apart.min())
        return bool(gaps[0] < GUARD and gaps[0] < gaps[1] - 1e-6)

    def told(self) -> Simulation:
        """Return the drive with its contacts and costs."""
        times, poses, measured, commands, velocities, people, off = zip(*self.rows, strict=True)
        time, pose = np.array(times), np.array(poses, float)
        walked = np.array(people, float).reshape(len(times), -1, 4)
        base = self.base
        return Simulation(
            times=time,
            poses=pose,
            measured=np.array(measured, float),
            commands=np.array(commands, float),
            people=walked,
            radius=self.people.radius,
            off=np.array(off),
            bound=farthest_off(self.limits, base.delay, base.slip, base.noise),
            late=self.late,
            braked=self.braked,
            contacts=(*self._wall_contacts(pose, time), *self._contacts(pose, time, walked)),
            arrived=self.finished,
            planned=self.problem.evaluate(self.trajectory),
            driven=self._driven_costs(pose, np.array(velocities, float), time, walked),
        )

    def _wall_contacts(self, poses: FloatArray, times: FloatArray) -> Sequence[str]:
        """Return a sentence for the first contact with an obstacle, judged by python-fcl; [] if there is none."""
        free = self.robot.judge(self.problem.world.with_content()).states_free(self._states(poses))
        touched = np.flatnonzero(~free)
        return [f"touches an obstacle at {times[touched[0]]:.2f} s"] if touched.size else []

    def _contacts(self, poses: FloatArray, times: FloatArray, people: FloatArray) -> Sequence[str]:
        """Return a sentence for the first contact with each person."""
        found, states = list[str](), self._states(poses)
        for i in range(people.shape[1]):
            gap = distance_to_outline(self.robot.platform, states, people[:, i, :2]) - self.people.radius
            touched = np.flatnonzero(gap <= 0.0)  # NaN is not
            if touched.size:
                found.append(f"touches person {i} at {times[touched[0]]:.2f} s")
        return found

    def _states(self, poses: FloatArray) -> States:
        """Return states of the robot at poses (N, 3); its joints are as at the start of the plan."""
        first = {name: np.full(len(poses), getattr(self.trajectory.states, name)[0]) for name in self.robot.space.names}
        return States(**first | {"x": poses[:, 0], "y": poses[:, 1], "yaw": poses[:, 2]})

    def _driven_costs(
        self, poses: FloatArray, velocities: FloatArray, times: FloatArray, people: FloatArray
    ) -> dict[str, float]:
        """Return the costs of the true motion; {} if the robot has no curves.

        They count the people as they walked. If a person was absent for a time, or the people are not as many as those
        of the problem, they count the people of the problem as predicted.
        """
        kind = Drive().kind
        if kind not in self.robot.laws or not is_curve(self.robot.laws[kind]):
            return {}
        columns = {name: poses[:, i] for i, name in enumerate(("x", "y", "yaw"))}
        columns |= {"speed": velocities[:, 0], "turn_rate": velocities[:, 1], "clock": times}
        true = Trajectory(self.robot, States(**columns), (kind,) * (len(times) - 1))
        problem, content = self.problem, self.problem.world.content
        if people.size and len(content.people) == people.shape[1] and np.isfinite(people).all():
            walked = [Track(times, people[:, i, 0], people[:, i, 1], recorded=True) for i in range(people.shape[1])]
            own = [Person.along(track, radius=self.people.radius) for track in walked]
            world = problem.world.with_content(
                people=own, groups=content.groups, landmarks=content.landmarks, zones=content.zones
            )
            problem = Problem(world, problem.model, problem.start, problem.goal, problem.criteria, tour=problem.tour)
        return problem.evaluate(true)
