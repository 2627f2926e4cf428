"""Robots made of parts and laws: what they plan by is never kinder than what judges them, whatever they move."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pytest
import shapely

from hpop import DifferentialDrive, Problem, Trajectory, World
from hpop.errors import ModelError
from hpop.models.base import PlanarModel, model, plane_space
from hpop.models.laws import Move, rest_to_rest
from hpop.motions import Leg, Motions, Phase, States
from hpop.planners.judgement import judge
from hpop.problems.verify import collision_free
from tests.models.collision.test_planar import LONG, ROBOTS, random_states, room


@dataclass(frozen=True)
class Slide:
    """Straight in any direction, the heading changing evenly; with a profile from rest to rest, as it is executed."""

    kind: str = "slide"
    varies = frozenset({"x", "y", "yaw"})

    def phases(self, start, end):
        length = np.hypot(end.x - start.x, end.y - start.y)
        if self.kind == "slide":
            return (Phase(length, 0.0 * length, 1.0 + 0.0 * length, "cruise"),)
        return rest_to_rest(length, 1.0, 1.0)

    def interpolate(self, name, start, end, share):
        return getattr(start, name) + (getattr(end, name) - getattr(start, name)) * share


@dataclass(frozen=True)
class Pan:
    """The head turns, and the base stands."""

    kind = "pan"
    varies = frozenset({"pan"})

    def phases(self, start, end):
        return rest_to_rest(np.abs(end.pan - start.pan), 1.0, 1.0)

    def interpolate(self, name, start, end, share):
        return getattr(start, name) + (getattr(end, name) - getattr(start, name)) * share


@dataclass(frozen=True)
class Omnidirectional(PlanarModel):
    """A base that slides, with a head that pans: no more than its states, laws, parts and bodies."""

    geometry: DifferentialDrive = field(default_factory=DifferentialDrive)

    name = "omnidirectional"
    executed = {"slide": "glide"}  # noqa: RUF012

    @cached_property
    def space(self):
        plane = plane_space(1.0)
        more = {"names": ("pan",), "units": ("rad",), "low": (-3.0,), "high": (3.0,), "weights": (1.0,)}
        return replace(plane, **{name: getattr(plane, name) + value for name, value in more.items()})

    @cached_property
    def laws(self):
        return {"slide": Slide(), "glide": Slide("glide"), "pan": Pan()}

    @property
    def parts(self):
        return self.geometry.parts

    @property
    def mounts(self):
        return self.geometry.mounts


OWN = {
    "round": Omnidirectional(),
    "camera ahead": Omnidirectional(DifferentialDrive(radius=0.2, camera_offset=(0.35, -0.1))),
    "long": Omnidirectional(DifferentialDrive(footprint=LONG)),
}


def random_motions(model, world, kind, seed, size=150):
    """Motions of up to a metre and half a turn either way from anywhere in a room and a little beyond."""
    rng, start = np.random.default_rng(seed), random_states(seed + 7, size)
    varies, still = model.laws[kind].varies, np.zeros(size)
    length, direction = rng.uniform(0.0, 1.0, size), start.yaw
    if "yaw" in varies:
        direction = rng.uniform(-np.pi, np.pi, size)
    go = {"x": length * np.cos(direction), "y": length * np.sin(direction), "yaw": rng.uniform(-np.pi, np.pi, size)}
    begin = {name: getattr(start, name, still) for name in model.space.names}
    end = {name: begin[name] + go.get(name, 1.0) * (name in varies) for name in begin}
    return Motions(world, model, model.laws[kind], States(**begin), States(**end))


CASES = [(robot, kind) for robot in ROBOTS.values() for kind in ("move", "turn")]
CASES += [(robot, kind) for robot in OWN.values() for kind in ("slide", "pan")]


@pytest.mark.cases(
    but=("differential_drive-turn1", "differential_drive-turn2", "omnidirectional-slide1", "omnidirectional-pan1")
)
@pytest.mark.parametrize(("robot", "kind"), CASES, ids=lambda case: getattr(case, "name", case))
def test_a_motion_that_planning_calls_free_is_free_to_the_judge(robot, kind):
    seed = 1
    world = room(seed)
    motions = random_motions(robot, world, kind, seed)
    free, judged = robot.collision(world).motions_free(motions), robot.judge(world).motions_free(motions)
    assert 0.02 < free.mean() < 0.95
    assert not (free & ~judged).any()
    assert (judged & ~free).mean() < 0.05  # by hulls that cover turns, and between two samples of the judge


def test_states_and_reasons_are_the_same_by_both():
    world, states = room(3), random_states(5, 200)
    for robot in (ROBOTS["not convex"], OWN["long"]):
        geometry, judge = robot.collision(world), robot.judge(world)
        assert (geometry.states_free(states) == judge.states_free(states)).mean() > 0.98
        for i in range(40):
            one = states.take(slice(i, i + 1))
            assert bool(geometry.why_blocked(one)) == (not geometry.states_free(one)[0])
            assert bool(judge.why_blocked(one)) == (not judge.states_free(one)[0])


def test_what_a_part_sweeps_while_the_robot_slides_and_turns_is_not_missed():
    """The long robot is free at both ends and turns by half round a pin that it meets only on its way."""
    robot = OWN["long"]
    world = World.from_polygons([shapely.box(4.99, 5.5, 5.01, 5.6)], extent=shapely.box(0, 0, 10, 10))
    for turn, expected in ((np.pi, False), (-np.pi, True)):
        begin, end = ({"x": x, "y": 5.0, "yaw": yaw, "pan": 0.0} for x, yaw in ((4.9, 0.0), (5.1, turn)))
        states = (States(**{name: np.array([value]) for name, value in one.items()}) for one in (begin, end))
        motion = Motions(world, robot, robot.laws["slide"], *states)
        assert robot.collision(world).motions_free(motion)[0] == expected
        assert robot.judge(world).motions_free(motion)[0] == expected


def trajectory(rows, kinds):
    columns = np.array(rows, float).T
    return Trajectory(OWN["round"], States(**dict(zip(("x", "y", "yaw", "pan"), columns, strict=True))), kinds)


def test_slides_that_go_on_alike_are_executed_as_one_and_pass_every_planned_state():
    rows = [(0, 0, 0, 0), (1, 1, 0.5, 0), (3, 3, 1.5, 0), (4, 4, 1.5, 0), (4, 4, 1.5, 1), (5, 4, 1.5, 1)]
    planned = trajectory(rows, ("slide", "slide", "slide", "pan", "slide"))
    executed, passed = planned.model.execution(planned)
    assert executed.kinds == ("glide", "glide", "pan", "glide")  # on the third it no longer turns
    assert (np.diff(passed) > 0).all()
    assert passed[-1] == pytest.approx(executed.duration)
    there = executed.at(passed)
    for name in planned.states.names:
        assert getattr(there, name) == pytest.approx(getattr(planned.states, name), abs=1e-4)


@dataclass(frozen=True)
class Striding(Omnidirectional):
    """Omnidirectional robot that also goes straight without turning, by the same law."""

    executed = {"slide": "glide", "stride": "glide"}  # noqa: RUF012

    @cached_property
    def laws(self):
        return {**super().laws, "stride": Move(1.0, "stride")}


def test_motions_of_two_laws_are_one_only_if_all_that_is_executed_goes_on_alike():
    rows = [(0, 0, 0, 0), (1, 0, 0.5, 0), (2, 0, 0.5, 0), (3, 0, 0.5, 0), (4, 0, 0.5, 0)]
    columns = dict(zip(("x", "y", "yaw", "pan"), np.array(rows, float).T, strict=True))
    planned = Trajectory(Striding(), States(**columns), ("slide", "stride", "slide", "stride"))
    executed, passed = planned.model.execution(planned)
    assert executed.kinds == ("glide", "glide")
    assert executed.at(passed).yaw == pytest.approx(planned.states.yaw)


def test_what_is_executed_may_be_executed_again():
    rows = [(0, 0, 0, 0), (1, 0, 0, 0), (1, 1, 0, 0)]
    executed = trajectory(rows, ("slide", "slide")).execution()
    assert executed.execution().kinds == executed.kinds == ("glide", "glide")


def test_only_a_robot_with_wheels_must_look_where_it_goes():
    sideways = [(0, 0, 0), (0, 2, 0)]
    columns = dict(zip(("x", "y", "yaw"), np.array(sideways, float).T, strict=True))
    drive = DifferentialDrive()
    slides = Trajectory(drive, States(**columns), ("move",))
    assert [*drive.faults(slides)] == ["goes sideways or backwards in motion 0, a move"]
    own = trajectory([(*row, 0.0) for row in sideways], ("slide",))
    assert [*own.model.faults(own)] == []


def test_what_a_model_provides_follows_from_its_states_and_laws():
    assert DifferentialDrive().provides >= {"plane", "turn-move", "rigid", "wheels", "base", "camera", "heading"}
    assert OWN["round"].provides == {"plane", "base", "camera"}


def test_a_model_within_a_model_is_described_by_its_own_parameters():
    described = OWN["long"].describe()
    assert described == {"omnidirectional": {"geometry": OWN["long"].geometry.describe()}}
    json.dumps(described)


@dataclass(frozen=True)
class Sighted(DifferentialDrive):
    """A drive with a parameter of its own that may be none, and is not by default."""

    view_range: float | None = 3.0


@pytest.mark.parametrize("given", [1.0, None])
def test_a_parameter_of_ones_own_is_described_whatever_its_name_and_though_it_is_none(given):
    assert Sighted(view_range=given).describe()["differential_drive"]["view_range"] == given
    assert "view" not in Sighted().describe()["differential_drive"]


def test_what_is_a_method_where_a_property_should_be_is_refused():
    class Forgetful(Omnidirectional):
        def parts(self):
            return ()

    with pytest.raises(ModelError, match="parts of model 'forgetful' must be a property, got a method"):
        model("forgetful")(Forgetful)


def test_a_leg_of_a_law_that_the_model_does_not_have_is_told():
    class Mistyped(Omnidirectional):
        def connect(self, a, b):
            return [Leg("slied", self.space.onward(a, b), np.ones(a.size, bool))]

    world = World.from_polygons([], extent=shapely.box(0, 0, 4, 3))
    problem = Problem(world, Mistyped(), (1, 1, 0, 0), (2, 1, 0, 0), ["length"])
    with pytest.raises(
        ModelError, match=r"connect must use only kinds of motion that are in its laws.* got \['slied'\]"
    ):
        problem.solve("roadmap", samples=5)


def test_an_object_that_is_half_a_model_is_refused_with_what_it_lacks():
    class Half:
        laws = space = provides = None

        def pose(self, body, states):
            raise NotImplementedError

    with pytest.raises(ModelError, match=r"lacks .*collision, judge, execution, faults.*PlanarModel"):
        Problem(room(0), Half(), (1, 1, 0), (2, 2, 0), ["length"])
    with pytest.raises(ModelError, match=r"such as hpop.DifferentialDrive\(radius=0.3\), got 3$"):
        Problem(room(0), 3, (1, 1, 0), (2, 2, 0), ["length"])


def test_a_robot_with_a_head_that_slides_is_evaluated_and_judged():
    world = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=shapely.box(0, 0, 10, 10))
    start, goal = (1, 1, 0, 0), (8, 1.5, 1, 0.5)
    planned = trajectory([start, (4, 1, 0.5, 0), (8, 1.5, 1, 0), goal], ("slide", "slide", "pan"))
    problem = Problem(world, planned.model, start, goal, ["length", "rotation", "sickness"])
    costs = problem.evaluate(planned)
    assert costs["length"] == pytest.approx(3 + np.hypot(4, 0.5))
    assert costs["rotation"] == pytest.approx(1.0)  # the camera stands on the base
    assert collision_free(problem, [planned]).all()
    assert judge(problem, problem.criteria[:2], [planned]).reasons == ("",)


@pytest.mark.parametrize("asked", ["why_blocked", "states_free"])
def test_a_collision_test_asked_with_plain_numbers_says_how_to_make_states(asked: str) -> None:
    model = DifferentialDrive()
    collision = model.collision(World.from_occupancy_grid(np.zeros((20, 20), int), 0.5))
    with pytest.raises(TypeError, match=rf"{asked}: .* must be a States \(made by model\.space\.state\("):
        getattr(collision, asked)((1.0, 2.0, 0.0))
