"""The picture of a look: where the robot is free, the ends, and what cannot be used."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.goals import Anywhere
from hpop.view.look import look
from hpop.world import Box, Solid, pose_at
from hpop.world.content.content import Landmark, Person, Zone
from tests.models.serial_arm.arms import arm6
from tests.two_arms import SWEEP, TABLE, two_arms

ROBOT = hpop.DifferentialDrive(radius=0.25)
HALL = hpop.World.from_polygons([shapely.box(4, 0, 4.2, 6)], extent=shapely.box(0, 0, 10, 6))


def seen(start=(1.0, 1.0, 0.0), goal=(3.0, 5.0, None), world=HALL, model=ROBOT):
    return look(hpop.Problem(world, model, start, goal, ["length"]), "a hall")


def texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def drawn(figure, gid):
    return figure.findobj(lambda artist: artist.get_gid() == gid)


def test_each_place_is_coloured_by_whether_the_robot_is_free_there_and_whether_the_start_reaches_it():
    found = seen()
    assert found.refused == ()
    (image,) = drawn(found.figure, "free space")
    kinds, (x0, x1, y0, y1) = np.asarray(image.get_array()), image.get_extent()
    for (x, y), kind in (((2.0, 3.0), 1), ((8.0, 3.0), 2), ((0.1, 3.0), 0), ((4.1, 3.0), 0)):
        row, column = (
            int((v - a) / (b - a) * n) for v, a, b, n in ((y, y0, y1, len(kinds)), (x, x0, x1, kinds.shape[1]))
        )
        assert kinds[row, column] == kind
    assert {"free, and within reach of the start", "free, but cut off from the start"} <= set(texts(found.figure))
    assert "2 parts between which it cannot go" in found.notes[0]
    assert found.figure.axes[0].get_xlabel() == "x (m)"
    assert drawn(found.figure, "scale bar")


def test_a_goal_in_another_part_is_told():
    assert "no path seems to lead from the start to the goal" in seen(goal=(8.0, 3.0, None)).notes[1]
    assert len(seen().notes) == 1


def test_stops_that_a_plan_would_refuse_are_noted() -> None:
    world = HALL.with_content(landmarks=[Landmark(4.1, 3.0, 1.0, name="in the wall")])
    stops = [{"landmark": "in the wall", "within": 0.1}, {"at": (4.1, 5.0), "within": 0.2, "name": "on the wall"}]
    stops += [{"landmark": "in the wall", "within": 2.0, "name": "seen"}, {"at": (2.0, 2.0), "within": 0.5}]
    problem = hpop.Problem(world, ROBOT, (1, 1, 0), (3, 5, None), ["length"], tour=hpop.Tour(stops, order="any"))
    found = look(problem, "a hall")
    _, first, second = found.notes
    crosses = [tuple(line.get_xydata()[0]) for line in found.figure.axes[0].lines if line.get_gid() == "doubtful stop"]
    assert crosses == [(4.1, 3.0), (4.1, 5.0)]
    assert "stop that a plan may refuse" in texts(found.figure)
    assert "may refuse this tour: stop 'in the wall' cannot be visited" in first
    assert "may refuse this tour: stop 'on the wall' cannot be visited" in second
    with pytest.raises(hpop.errors.QueryError, match="stop 'in the wall' cannot be visited"):
        problem.solve("lattice", step=0.5)


def test_ends_that_cannot_be_used_are_told_with_the_nearest_place_that_can_and_it_is_drawn():
    found = seen(start=(4.1, 3.0, 0.0), goal=[(1.0, 1.0, 0.0), (9.9, 3.0, 0.0)])
    start, goal = found.refused
    assert start.startswith("the start (4.1, 3) is not usable: it is inside an obstacle. Move it. The nearest place")
    assert goal.startswith("the goal 1 (9.9, 3) is not usable: ")
    marks = drawn(found.figure, "usable")
    places = np.array([(mark.get_xdata()[0], mark.get_ydata()[0]) for mark in marks])
    assert ROBOT.collision(HALL).clear(*places.T).all()
    (claim,) = drawn(found.figure, "claim")
    assert "is not usable" in claim.get_text()


def test_people_landmarks_and_zones_are_in_it():
    people = [Person(1.0, 3.0, name="Ada"), Person(2.0, 3.0, velocity=(0.5, 0.0))]
    zones = [Zone("speed", shapely.box(5, 1, 7, 2), limit=0.5), Zone("keep-out", shapely.box(8, 1, 9, 2))]
    world = HALL.with_content(people=people, landmarks=[Landmark(3.0, 5.5, name="door")], zones=zones)
    said = " ".join(texts(seen(world=world).figure))
    for word in ("person", "walking", "landmark", "speed limit", "keep-out zone", "S: start", "G: goal, any heading"):
        assert word in said


@pytest.mark.parametrize("name", ["arm_shelf", "mobile_arm"])
def test_robots_beyond_the_plane_are_drawn_where_they_start(name):
    from pathlib import Path

    from hpop.scenario import load_scenario

    problem = load_scenario(Path(__file__).parents[2] / f"examples/{name}.yaml").problem
    found = look(problem, name)
    assert found.refused == ()
    assert drawn(found.figure, "robot")
    assert drawn(found.figure, "targets")


def test_a_working_arm_is_drawn_where_it_begins_and_named():
    arms = two_arms()
    looked = look(hpop.Problem(TABLE, arms, "home", Anywhere(), ["rotation"]), "two arms")
    begin = arm6().space.state((*SWEEP["joints"][0], 0.0, 0.0, 0.0))
    for figure, columns in ((looked.figure, [0, 1]), (looked.side, [2])):
        for gid, model, state in (("working arm", arm6(), begin), ("robot", arms.view, arms.view.space.state("home"))):
            (shown,) = drawn(figure, gid)
            corners = [Solid(shape, pose).corners[:, columns] for shape, (pose,) in model.bodies(state)]
            extents = np.concatenate([path.vertices for path in shown.get_paths()])[:, -len(columns) :]
            for end in (np.min, np.max):
                np.testing.assert_allclose(end(extents, axis=0), end(np.concatenate(corners), axis=0), atol=0.02)
        assert "the working arm at the start" in texts(figure)


def test_an_arm_is_seen_from_the_side_with_heights():
    """The outline spans the heights of the bodies at the start and the goal; letters are where the camera is."""
    arm = arm6()
    start, goal = (-0.27, 0.74, 1.73, 0.87, -0.05, -0.82), (0, 0.1, 0.2, 0, 0, 0)
    world = hpop.World.from_solids([Solid(Box((0.3, 1.0, 0.02)), pose_at((0.65, 0, 0.36)), "board")])
    figure = look(hpop.Problem(world, arm, start, goal, ["duration"]), "an arm").side
    (axes,) = figure.axes
    (drawn,) = [each for each in axes.collections if each.get_gid() == "robot"]
    highest = max(path.vertices[:, 1].max() for path in drawn.get_paths())
    states = hpop.motions.States(**dict(zip(arm.joints, np.array([start, goal]).T, strict=True)))
    corners = [Solid(shape, pose).corners for shape, poses in arm.bodies(states) for pose in poses]
    assert highest == pytest.approx(max(points[:, 2].max() for points in corners), abs=0.02)
    assert axes.get_ylim()[0] < 0.0 < highest < axes.get_ylim()[1]
    assert axes.get_ylabel().startswith("height (m)")
    camera = arm.pose("camera", states)
    letters = {text.get_text(): text for text in axes.texts if text.get_text() in ("S", "G")}
    assert sorted(letters) == ["G", "S"]
    assert letters["S"].get_position()[1] == pytest.approx(camera.z[0], abs=0.02)
    assert letters["G"].get_position()[1] == pytest.approx(camera.z[1], abs=0.02)
    assert seen().side is None  # a robot without bodies in space
