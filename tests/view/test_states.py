"""The states of a robot along time: which are drawn, in which unit, between which limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hpop
from hpop.motions import States
from hpop.view import draw_states
from hpop.view.trace import changing
from tests.two_arms import two_arms
from tests.view.robots import Lift, Reacher
from tests.view.test_side import LEVEL, LIFTED, REACHED, seen, through
from tests.view.test_sight import HEAD, trajectory


def panels(figure):
    return {axes.get_title(loc="left"): axes for axes in figure.axes}


def by_gid(axes, gid):
    return [line for line in axes.lines if line.get_gid() == gid]


def test_joints_are_in_degrees_between_their_limits():
    _, front = seen(Reacher(), REACHED, [REACHED[0], REACHED[-1]])
    drawn = panels(draw_states(front))
    assert list(drawn) == ["waist (°)", "shoulder (°)"]
    (line,) = by_gid(drawn["shoulder (°)"], "shoulder of knee, least duration")
    way = front.trajectories[0]
    times, values = line.get_xydata().T
    np.testing.assert_allclose(values, np.degrees(way.at(times).shoulder))
    assert values.max() == pytest.approx(math.degrees(0.8))
    assert times[-1] == way.duration
    limits = [line.get_ydata()[0] for line in by_gid(drawn["shoulder (°)"], "limit of shoulder")]
    assert limits == pytest.approx([math.degrees(-0.8), math.degrees(1.4)])
    assert by_gid(drawn["waist (°)"], "limit of waist") == []  # it turns without end


def test_what_the_map_shows_is_left_out_and_what_never_changes_is_named():
    _, front = seen(Lift(), LIFTED, LEVEL)
    figure = draw_states(front)
    assert list(panels(figure)) == ["lift (m)"]
    assert figure.get_suptitle() == "The robot's states along time, as planned; yaw does not change"
    assert [line.get_ydata()[0] for line in by_gid(panels(figure)["lift (m)"], "limit of lift")] == [0.0, 1.2]
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert texts == ["knee, least duration", "least rotation", "limit"]


def test_neither_time_nor_pace_is_drawn_of_an_arm_beside_another():
    arms, (a, b) = two_arms(), ((0.0,) * 6, (0.2, 0.1, *(0.0,) * 4))
    rows = np.array([(*a, 0.0, 0.0), (*b, 0.0, 1.0), (*b, 0.0, 2.0)])
    planned = hpop.Trajectory.through(arms, States(**dict(zip(arms.space.names, rows.T, strict=True))))
    assert changing(arms, [planned]) == list(arms.joints[:2])


def test_nothing_is_drawn_of_a_robot_whose_states_are_on_the_map():
    drive = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(1, 1, 0), (3, 1, 1), (3, 4, 2)])
    assert changing(drive.model, [drive]) == []
    assert changing(Lift(), [through(Lift(), LEVEL)]) == []
    assert changing(HEAD, [trajectory(HEAD)]) == ["yaw", "pan"]
