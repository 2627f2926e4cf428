"""Joint limits: nothing in the middle of all ranges, one second a second at all stops."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import JointLimits, motion_costs, trajectory_cost
from hpop.motions import Motions
from tests.jointed import Jointed, agrees_everywhere, states_of, tour

WORLD = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def share(model, row):
    """Cost a second in a posture that hardly changes."""
    here, there = (states_of(model, [(row[0] + change, *row[1:])]) for change in (0.0, 1e-7))
    motions = Motions(WORLD, model, model.laws["reach"], here, there)
    return float(motion_costs(JointLimits(), motions)[0] / motions.duration[0])


def test_stops_cost_one_the_middle_nothing_and_half_way_a_quarter():
    model = Jointed()  # "twist" turns without end: it has no stops
    assert share(model, (0.0, 0.0, 2.0)) == pytest.approx(0.0, abs=1e-12)
    assert share(model, (2.5, -1.2, 0.0)) == pytest.approx(1.0, rel=1e-6)
    assert share(model, (1.25, 0.6, 0.0)) == pytest.approx(0.25, rel=1e-6)
    assert share(model, (2.5, 0.0, 0.0)) == pytest.approx(0.5, rel=1e-6)


def test_it_is_the_mean_square_of_what_is_sampled():
    model, trajectory = Jointed(), tour(Jointed())
    count = 20_000
    states = trajectory.at((np.arange(count) + 0.5) * trajectory.duration / count)
    rate = 0.5 * ((states.swing / 2.5) ** 2 + (states.lift / 1.2) ** 2)
    assert agrees_everywhere(JointLimits(), model, WORLD) == pytest.approx(rate.mean() * trajectory.duration, rel=1e-5)


def test_a_head_that_cannot_tilt_and_pans_all_round_has_no_stops():
    head = hpop.PanTilt(pan="all round", tilt=(0.0, 0.0))
    pan = hpop.Trajectory(head, states_of(head, [(0, 0, 0, 0, 0), (0, 0, 0, 1, 0)]), ("pan",))
    assert trajectory_cost(JointLimits(), pan, WORLD) == 0.0
    stops = replace(head, pan=(-1.0, 1.0))
    at_a_stop = hpop.Trajectory(stops, states_of(stops, [(0, 0, 0, 1, 0), (3, 0, 0, 1, 0)]), ("move",))
    assert trajectory_cost(JointLimits(), at_a_stop, WORLD) == pytest.approx(at_a_stop.duration)


def test_what_it_declares():
    assert (JointLimits.group, JointLimits.unit, JointLimits.aggregate) == ("R", "s", "sum")
