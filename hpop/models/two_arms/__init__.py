"""Robot model "two_arms": an arm with a camera that watches another arm, whose motion is given."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.options import BesideScenario, real
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import model
from hpop.models.files import without_paths
from hpop.models.rigid import FieldOfView
from hpop.models.serial_arm import SerialArm
from hpop.models.serial_arm.chain import levers
from hpop.models.serial_arm.laws import JointSpline, doubtful, faults
from hpop.models.two_arms.collision import BothArms, TwoArmsCollision, TwoArmsJudge
from hpop.models.two_arms.motion import PACE, STEP, TIME, ReachInTime, WorkMotion
from hpop.motions import Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist, integrated
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.geometry.solids import Shape

WORK_TOOL = "work_tool"  # body: the tool of the working arm
START = "start"  # name of the start in messages of a problem
SAME = 1e-6  # s: tolerance of times
SHORTEST, LONGEST = 0.01, 10.0  # s, bounds of a time step


@model("two_arms")
@dataclass(frozen=True, eq=False)
class TwoArms(Model):
    """Arm with a camera that watches another arm at its work; states are the viewing arm's joints, pace and time.

    work    working arm; or a trajectory of it, which is then its motion
    view    viewing arm, which carries the camera and is planned for; its ``base`` is its place in the world
    motion  motion of the working arm: a trajectory, a CSV file with the columns t and each joint (as written by
            ``hpop export FOLDER --body joints --format csv``), or {"times": [...], "joints": {joint: [...]}}
    step    s  motions and waits of the viewing arm begin and end at multiples of this time, made a little shorter so
               that the working arm's motion lasts a whole number of steps

    The working arm moves as given, evenly between the rows of its motion; a trajectory is sampled every 0.01 s. Every
    plan of the viewing arm begins and ends with that motion. The body "work_tool" is the working arm's tool; criteria
    may have it as their target, as in ``{"look_at": {"target": "work_tool"}}``. ``occlusion`` counts both arms. The
    pace of a state says how fast the arm moves, as a share of its top speed. Users may leave pace and time out.
    """

    name: ClassVar[str]
    watched: ClassVar[str] = WORK_TOOL

    work: SerialArm
    view: SerialArm
    motion: Annotated[Any, BesideScenario] = None
    step: float = 0.1

    def __post_init__(self) -> None:
        given: Any = self.work
        if isinstance(given, Trajectory):
            if self.motion is not None:
                raise ModelError("work is a trajectory, which is the motion as well; leave motion out, or give an arm")
            object.__setattr__(self, "work", given.model)
            object.__setattr__(self, "motion", given)
        for name, arm in (("work", self.work), ("view", self.view)):
            if not isinstance(arm, SerialArm):
                raise ModelError(f"{name} must be a serial arm, SerialArm(...), got {shown(arm)}")
        if isinstance(self.motion, Trajectory) and self.motion.model != self.work:
            raise ModelError(
                "motion is a trajectory of another arm than work; give this trajectory as work, and leave motion out"
            )
        if taken := {PACE, TIME} & set(self.view.joints):
            raise ModelError(f"no joint of the viewing arm may be called {min(taken)!r}; rename it in the URDF")
        if self.view.paces:
            raise ModelError(
                f"the viewing arm must have one velocity_scaling, got {shown(self.view.velocity_scaling)}; its plans "
                "choose when to move, and how long to wait"
            )
        step = real("step", self.step, SHORTEST, LONGEST, "a time in s", error=ModelError)
        object.__setattr__(self, "step", float(step))
        object.__setattr__(self, "motion", WorkMotion.of(self.motion, self.work.chain))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TwoArms) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @cached_property
    def _identity(self) -> str:
        return json.dumps(without_paths(self.describe()), sort_keys=True)

    def __repr__(self) -> str:
        arms = f"{len(self.view.joints)} joints that view {len(self.work.joints)}"
        return f"<{type(self).__name__}: {arms}, {self.motion.duration:.3g} s>"

    # Structure

    @property
    def timeless(self) -> SerialArm:
        """Model of the viewing arm alone, whose states lack the time."""
        return self.view

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: the bodies "camera", "tool" (of the viewing arm) and "work_tool", "joints", and "time"."""
        return frozenset({"camera", "tool", WORK_TOOL, "joints", TIME})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the viewing arm's joints."""
        return self.view.joints

    @property
    def field_of_view(self) -> FieldOfView | None:
        """Field of view of the viewing arm's camera, (horizontal, vertical) rad, or None for all round."""
        return self.view.field_of_view

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on assumptions about both arms, to be printed with every front."""
        given = (
            "the working arm is taken to move exactly as given, evenly between the rows of its motion (a trajectory is "
            f"sampled every {STEP:g} s); its own contacts with obstacles and with itself were not checked"
        )
        return (*self.view.notes, *(f"working arm: {note}" for note in self.work.notes), given)

    @cached_property
    def space(self) -> StateSpace:
        """States: the viewing arm's joints, its pace and the time; only joints count in distances."""
        arm = self.view.space
        return SpaceInTime(
            (*arm.names, PACE, TIME),
            (*arm.units, "1", "s"),
            (*arm.low, 0.0, 0.0),
            (*arm.high, 0.0, self.motion.duration),
            (*arm.weights, 0.0, 0.0),
            arm.turning,
            named=arm.named,
            unnamed=arm.unnamed,
        )

    @cached_property
    def law(self) -> ReachInTime:
        """Motion law of the viewing arm: a reach with a beginning and an end in time."""
        chain = self.view.chain
        return ReachInTime(JointSpline(chain.names, tuple(chain.speed.tolist()), tuple(chain.acceleration.tolist())))

    @property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws: only "reach", which takes a given time; without a change of the joints it is a wait."""
        return {self.law.kind: self.law}

    @cached_property
    def both(self) -> BothArms:
        """Chain through both arms, with their solids."""
        return BothArms.of(self.work.chain, self.work.parts, self.view.chain, self.view.parts)

    # Motion

    def alone(self, states: States) -> States:
        """Return the states (N,) of the viewing arm, without pace and time."""
        return States(**{name: getattr(states, name) for name in self.view.joints})

    def motions_alone(self, motions: Motions, rows: IntArray | None = None) -> Motions:
        """Return motions of the viewing arm alone: the same lines in joint space, in the least time.

        rows  indices of the motions to return; by default all
        """
        start, end = self.alone(motions.start), self.alone(motions.end)
        if rows is not None:
            start, end = start.take(rows), end.take(rows)
        return Motions(motions.world, self.view, self.view.laws["reach"], start, end)

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of the camera, the viewing arm's tool or the working arm's tool in each of the states."""
        if body == WORK_TOOL:
            return self.work.pose("tool", self.motion.states(states.time))
        return self.view.pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity and angular velocity of a body."""
        if body == WORK_TOOL:
            return self.work.twist("tool", self.motion.states(states.time), self.motion.rates(states.time))
        return self.view.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the acceleration and angular acceleration of a body; the working arm's joints have none."""
        if body == WORK_TOOL:
            still = States(**dict.fromkeys(self.work.joints, 0.0 * states.time))
            moving = self.motion.states(states.time), self.motion.rates(states.time)
            return self.work.twist_rate("tool", *moving, still)
        return self.view.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return how a body moves in each motion.

        For bodies of the viewing arm, length and rotation do not depend on the timing. So they are computed once for
        all motions with equal start and end joints.
        """
        return integrated(name, motions) if name == WORK_TOOL else _BodyInTime(name, self, motions)

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """Return the shapes of both arms and their poses (N, 4, 4); they can hide things from the camera."""
        return [*self.view.bodies(states), *self.work.bodies(self.motion.states(states.time))]

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far any body moves and turns in each motion."""
        farthest, turned = self.view.extent(motions)
        ways, sliding = self.motion.ways(motions.start.time, motions.end.time), self.work.chain.sliding
        return np.maximum(farthest, ways @ levers(self.work.chain)), turned + ways[:, ~sliding].sum(axis=1)

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motion from states a to b: one reach, or a wait.

        If b is too early, the motion ends later, after the least time that the joints need.
        """
        leg, soonest = self._soonest(a, b)
        time: Column = np.where(b.time >= soonest - SAME * self.step, b.time, soonest)
        end = States(**{**leg.end.__dict__, PACE: 0.0 * time, TIME: time})
        return [Leg(self.law.kind, end, leg.present | (time > a.time))]

    def joinable(self, a: States, b: States) -> BoolArray:
        """Return a mask (M,): whether state b is late enough for a motion from state a."""
        return np.asarray(b.time >= self._soonest(a, b)[1] - SAME * self.step)

    def _soonest(self, a: States, b: States) -> tuple[Leg, Column]:
        """Return the viewing arm's motion from states a to b, and the earliest time (M,), s, at which it can end."""
        (leg,) = self.view.connect(self.alone(a), self.alone(b))
        return leg, a.time + self.law.least(a, leg.end)

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the plan itself and its times, because the arm executes its motions as planned."""
        return trajectory, trajectory.times

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each joint limit that is exceeded, and if the plan ends before or after the work."""
        states, count = trajectory.states, max(1, len(trajectory))
        start, end = states.take(slice(0, count)), states.take(slice(-count, None))
        yield from faults(self.view.chain, self.law, start, end, np.arange(count))
        if abs(float(states.time[-1]) - self.motion.duration) > SAME:
            yield f"ends at {states.time[-1]:.6g} s, but the working arm moves for {self.motion.duration:.6g} s"

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of motions in which a joint exceeds its limits, and of those that begin at time 0."""
        return np.asarray(doubtful(self.view.chain, self.law, start, end) | (start.time < SAME))

    # Collision tests

    def with_scene(self, world: World) -> TwoArms:
        """Return this model; ModelError if the scene attaches objects to links, or gives objects in frames of links.

        The scene does not say of which arm these links are.

        Raises ModelError as :meth:`hpop.SerialArm.with_scene` does, too.
        """
        if names := ", ".join(repr(each["name"]) for each in world.link_rules.attached):
            raise ModelError(
                f"two arms do not take the objects that a scene attaches to links ({names}); remove them from the "
                "scene, and give them to the arm that holds them, with its option attached or SerialArm.holding"
            )
        frames = world.link_rules.frames
        if names := ", ".join(repr(name) for name, frame in frames.items() if frame in self.links | self.work.links):
            raise ModelError(
                f"two arms do not take objects that a scene gives in the frame of a link ({names}), since it does not "
                "say of which arm; give them in the frame of the world"
            )
        self.view.with_scene(world)
        return self

    @property
    def links(self) -> frozenset[str]:
        """Names of all links of the viewing arm."""
        return self.view.links

    def collision(self, world: World) -> TwoArmsCollision:
        """Return the collision test for planning, with proofs for whole motions of both arms."""
        return TwoArmsCollision(self, world)

    def judge(self, world: World) -> TwoArmsJudge:
        """Return the collision test for verification: python-fcl at states between which no part moves over 1 mm."""
        return TwoArmsJudge(self, world)

    def judge_by(self, library: str, world: World) -> TwoArmsJudge:
        """Return :meth:`judge` with distances by a library, "fcl" or "coal".

        If coal is not installed, the first test by it raises ModelError.
        """
        return TwoArmsJudge(self, world, library)

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal model; the motion is given in full."""
        arms = {"work": self.work.describe(), "view": self.view.describe()}
        return {self.name: {**arms, "motion": self.motion.describe(), "step": self.step}}


class SpaceInTime(StateSpace):
    """State space with pace and time as its last columns, both of which users may leave out of a state.

    The time is then 0 in a start, and the end of the working arm's motion in other states. The pace is then 0.
    """

    def implied(self, what: str) -> dict[str, float]:
        """Return the values that a state gets for pace and time if the user leaves them out.

        ``what`` is "start" for the start of a problem, which gets the time 0; every other state gets the last time.
        """
        return {PACE: 0.0, TIME: 0.0 if what == START else self.high[-1]}


class _BodyInTime(Body):
    """Motion of the viewing arm's camera or tool: computed once for equal lines in joint space."""

    def __init__(self, name: str, arms: TwoArms, motions: Motions) -> None:
        ends = {key: arms.pose(name, states) for key, states in (("start", motions.start), ("end", motions.end))}
        self.__dict__.update(ends, _name=name, _arms=arms, _motions=motions)

    _name: str
    _arms: TwoArms
    _motions: Motions

    @cached_property
    def _lines(self) -> tuple[Body, IntArray]:
        """Motion along each distinct line, and the line (M,) of each motion."""
        joints = self._arms.joints
        ends = [getattr(states, name) for states in (self._motions.start, self._motions.end) for name in joints]
        _, first, which = np.unique(np.stack(ends, axis=1), axis=0, return_index=True, return_inverse=True)
        alone = self._arms.motions_alone(self._motions, first)
        return self._arms.view.body(self._name, alone), which.ravel()

    @cached_property
    def length(self) -> Column:
        return self._lines[0].length[self._lines[1]]

    @cached_property
    def turned(self) -> Column:
        return self._lines[0].turned[self._lines[1]]

    @cached_property
    def rotation(self) -> Column:
        return self._lines[0].rotation[self._lines[1]]

    @property
    def turns(self) -> tuple[Column, ...]:
        return (self.rotation,)
