"""A plan is handed to the robot only if it can still change to it, and meets no person as people walk at that time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.live.stepped import SteppedSession, Walkers
from tests.worlds import SECOND, TWO_WALLS

ROOM = TWO_WALLS.replace("step: 0.25", "step: 0.5")


@pytest.fixture
def session_of(tmp_path: Path) -> Callable[..., SteppedSession]:
    def make(
        late: Callable[[str], float], *people: tuple[float, float, float, float], room: str = ROOM
    ) -> SteppedSession:
        file = tmp_path / "room.yaml"
        file.write_text(room)
        return SteppedSession(file, tmp_path, Walkers(*people), late)

    return make


def driven(session: SteppedSession) -> None:
    session.go(0.1)
    session.say("destination", x=6.0, y=4.0)
    options = session.wait_for("options")
    session.say("take", option=options["cards"][0]["option"], asked=options["asked"])
    assert session.go(20.0, lambda: session.robot.pose[0] > 1.2 or session.robot.pose[1] > 1.2)


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 2.0, 3.0])
def test_a_robot_stays_on_a_checked_path_however_late_the_answer_to_a_push_is(
    session_of: Callable[..., SteppedSession], late: float
) -> None:
    session = session_of(lambda kind: late if kind == "push" else 0.05)
    driven(session)
    for _ in range(6):
        for direction in (1.5, -1.5):
            session.say("push", direction=direction)
            session.go(late + 0.3)
    assert sum(message["type"] == "pushed" for message in session.told) >= 6
    assert session.off < 0.1


def test_a_way_is_not_driven_into_a_person_who_began_to_walk_while_it_was_found(
    session_of: Callable[..., SteppedSession],
) -> None:
    """She stands where no way leads, and begins to walk while the choice of a way is on its way."""
    session = session_of(lambda kind: 1.5 if kind == "take" else 0.05, (6.6, 0.4, 0.0, 0.0))
    session.go(0.1)
    session.say("destination", x=6.0, y=4.0)
    options = session.wait_for("options")
    session.say("take", option=options["cards"][0]["option"], asked=options["asked"])
    assert session.live.offer is not None
    way = session.live.offer.ways.trajectories[options["cards"][0]["option"]].execution().at(4.0)
    walkers = session._pedestrians
    assert isinstance(walkers, Walkers)
    walkers.people = [(float(way.x[0]) + 2.2, float(way.y[0]), -0.4, 0.0)]  # she is there when the robot would be
    assert session.go(90.0, lambda: session.told[-1]["type"] == "arrived")
    assert session.met == []
    assert session.gap > 0
    assert session.off < 0.1


def test_a_robot_goes_round_a_person_who_is_wider_than_most(session_of: Callable[..., SteppedSession]) -> None:
    """She stands with a pram, whose edge a way for a narrow person would touch."""
    session = session_of(lambda kind: 0.05, (4.5, 3.9, 0.0, 0.0), room=ROOM.replace(SECOND, ""))
    session._pedestrians.radius = 0.7
    session.go(0.1)
    session.say("destination", x=6.0, y=4.0)
    options = session.wait_for("options")
    session.say("take", option=options["cards"][0]["option"], asked=options["asked"])
    assert session.go(60.0, lambda: session.told[-1]["type"] == "arrived")
    assert session.met == []
    assert session.gap > 0


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_robot_drives_only_along_a_plan_that_the_planner_knows(
    session_of: Callable[..., SteppedSession], late: float
) -> None:
    """A push is answered while the end of the drive waits for another answer."""
    session = session_of(lambda kind: late if kind == "options" else 0.0)
    driven(session)
    session.go(2.0)
    session._ask_ways()
    session.go(0.02)
    session._leave_plan()
    for direction in (1.5, -1.5):
        session.say("push", direction=direction)
        session.go(0.02)
    session.go(late + 2.0)
    session.say("go")
    session.go(1.0)
    assert session.live.drive is not None or session.robot.stands


def test_each_person_is_passed_at_a_distance_for_the_own_width(session_of: Callable[..., SteppedSession]) -> None:
    """She stands with a pram; a child stands beside a gap that would be too narrow if the child were as wide."""
    people, widths = ((4.5, 3.9, 0.0, 0.0), (6.9, 4.0, 0.0, 0.0)), (0.7, 0.15)
    session = session_of(lambda kind: 0.05, *people, room=ROOM.replace(SECOND, ""))
    session._radii = widths
    session.go(0.1)
    session.say("destination", x=6.0, y=4.0)
    options = session.wait_for("options")
    session.say("take", option=options["cards"][0]["option"], asked=options["asked"])
    assert session.go(60.0, lambda: session.told[-1]["type"] == "arrived")
    assert tuple(person.radius for person in session.live.surroundings.people) == widths
    assert session.met == []
    assert session.gap > 0
