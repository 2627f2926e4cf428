"""A person who walks slowly against the robot at its start, or may be in contact with it there, leaves it paths."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.problems.verify import verify
from hpop.trajectories.contacts import contact
from hpop.world import Person, World

ROBOT = hpop.DifferentialDrive(radius=0.3)
ROOM = World.from_polygons([], extent=shapely.box(0, 0, 5, 4))
STRAY = 0.125
"""m: v²/8a of a robot of 1 m/s and 1 m/s²."""


def planned(person: Person, **options: float) -> tuple[hpop.Problem, hpop.Front]:
    world = ROOM.with_content(people=[person])
    problem = hpop.Problem(world, ROBOT, (1.0, 2.0, 0.0), (4.0, 2.0, None), ["duration", "length"], horizon=8.0)
    return problem, problem.solve("lattice", step=0.5, **options)


@pytest.mark.cases("0.4-0.2", "-0.02-0.0")
@pytest.mark.parametrize(("gap", "margin"), [(0.4, 0.0), (0.4, 0.2), (0.0, 0.0), (-0.02, 0.0)])
def test_the_front_is_that_among_people_who_stop_before_the_robot(gap: float, margin: float) -> None:
    walks = Person(1.55 + gap, 2.0, velocity=(-0.3, 0.0), until=6.0, name="Bob")
    problem, front = planned(walks, margin=margin)
    assert any("'Bob'" in note and "stop before" in note for note in front.notes)
    assert front.provenance[0]["people_who_stop"] == [0]
    assert not verify(problem, front)
    # Stops 2 cm before what the robot needs, found here by hand; at once where that is nearer already.
    until = max(0.0, np.floor((gap - margin - STRAY - 0.02) / 0.3 * 100 + 1e-9) / 100)
    stops = Person(walks.x, walks.y, velocity=walks.velocity, until=until, afterwards="stays", name="Bob")
    _, other = planned(stops, margin=margin)
    assert len(front)
    assert np.array_equal(front.costs, other.costs)
    x, y = stops.at(60.0)
    for trajectory in front.trajectories:
        for way in (trajectory, trajectory.execution()):
            states = way.at(np.arange(0.0, way.duration, 0.01))
            x, y = stops.at(np.arange(0.0, way.duration, 0.01))
            apart = np.hypot(states.x - x, states.y - y) - 0.55
            assert apart.min() >= min(0.0, gap) - 1e-3


def test_who_can_be_avoided_does_as_predicted() -> None:
    problem, front = planned(Person(2.5, 2.0, velocity=(-0.3, 0.0), until=6.0, name="Bob"))
    assert len(front)
    assert not any("stop before" in note for note in front.notes)
    people = problem.world.content.people
    assert not any(contact(ROBOT.parts, people, trajectory) for trajectory in front.trajectories)


def test_a_front_that_names_nobody_is_not_believed_to_leave_contact() -> None:
    problem, front = planned(Person(1.65, 2.0, velocity=(-0.3, 0.0), until=6.0, name="Bob"))
    silent = hpop.Front.of(
        front.costs,
        front.trajectories,
        names=front.names,
        units=front.units,
        quanta=front.quanta,
        groups=front.groups,
        problem=front.problem,
    )
    assert any("touches Bob" in fault for fault in verify(problem, silent))


UNCERTAIN = {
    "stands ahead": Person(1.65, 2.0, spread=0.1, until=4.0, name="Ann"),
    "stands behind": Person(0.35, 2.0, spread=0.1, until=4.0, name="Ann"),
    "stands, less and less surely": Person(1.85, 2.0, spread=0.05, growth=0.3, until=4.0, name="Ann"),
    "walks away": Person(1.65, 2.0, velocity=(0.3, 0.0), spread=0.1, until=4.0, name="Ann"),
    "passes": Person(1.65, 1.6, velocity=(0.0, 0.5), spread=0.1, until=4.0, name="Ann"),
    "comes": Person(1.9, 2.0, velocity=(-0.3, 0.0), spread=0.1, until=4.0, name="Ann"),
}


@pytest.mark.cases("stands ahead-0.0", "comes-0.2")
@pytest.mark.parametrize("margin", [0.0, 0.2])
@pytest.mark.parametrize("name", UNCERTAIN)
def test_a_robot_may_leave_a_chance_of_contact(name: str, margin: float) -> None:
    """More than 5 % of where Ann may be is in contact with the robot at the start, or within the margin."""
    problem, front = planned(UNCERTAIN[name], margin=margin)
    assert len(front)
    assert not verify(problem, front)
    (ann,) = problem.world.content.people
    if not front.provenance[0].get("people_who_stop"):
        assert any("a chance above 5 % of contact with Ann" in note for note in front.notes)
        for trajectory in front.trajectories:
            times = np.arange(0.0, 4.0, 0.01)
            states, (x, y) = trajectory.at(times), ann.at(times)
            gap = np.hypot(states.x - x, states.y - y) - 0.55
            at_risk = gap < 1.6449 * ann.deviation(times)
            assert (np.diff(gap)[at_risk[:-1]] >= -1e-6).all()
