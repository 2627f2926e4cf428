"""Motions of an arm that go back through the same states: what adds up along both alike is added up once."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from hpop.criteria import make_criterion, motion_costs
from hpop.models.serial_arm.model import SerialArm
from hpop.motions import Motions, States
from hpop.world import World
from tests.models.serial_arm.arms import arm6, crane

WORLD = World.from_polygons([], extent=shapely.box(-1, -1, 1, 1))
COSTS = ["duration", "rotation", "camera_length", "joint_length", {"look_at": {"target": [0.5, 0.2, 0.3]}}]


@pytest.fixture(params=["arm6", "crane"])
def arm(request, tmp_path) -> SerialArm:
    return arm6() if request.param == "arm6" else crane(tmp_path)


def motions(arm: SerialArm, start: States, end: States) -> Motions:
    ((kind, end, _),) = arm.connect(start, end)
    return Motions(WORLD, arm, arm.laws[kind], start, end)


def joined(*states: States) -> States:
    return States(**{n: np.concatenate([getattr(s, n) for s in states]) for n in states[0].names})


@pytest.fixture
def ends(arm) -> tuple[States, States]:
    """Less than half a turn apart."""
    rng = np.random.default_rng(5)
    a, b = arm.space.sample(rng, 20), arm.space.sample(rng, 20)
    return a, States(**{n: getattr(a, n) + 0.4 * (getattr(b, n) - getattr(a, n)) for n in a.names})


def test_costs_of_motions_there_and_back_are_those_of_each_alone(arm, ends):
    a, b = ends
    together = motions(arm, joined(a, b), joined(b, a))
    for criterion in map(make_criterion, COSTS):
        alone = [motion_costs(criterion, motions(arm, *pair)) for pair in ((a, b), (b, a))]
        np.testing.assert_allclose(motion_costs(criterion, together), np.concatenate(alone), rtol=1e-9)


def test_rates_of_states_are_asked_for_one_of_both(arm, ends):
    a, b = ends
    asked = [0, 0]

    def integral(m: Motions, place: int) -> np.ndarray:
        def rate(s):
            asked[place] += np.size(s.camera.x)
            return 1.0 + s.camera.x**2

        return m.integrate(rate)

    there = integral(motions(arm, a, b), 0)
    both = integral(motions(arm, joined(a, b), joined(b, a)), 1)
    assert asked[0] == asked[1]
    np.testing.assert_array_equal(both, np.tile(there, 2))


def test_what_has_a_sign_changes_it_on_the_way_back(arm, ends):
    a, b = ends
    there, back = np.split(motions(arm, joined(a, b), joined(b, a)).camera.rotation, 2)
    np.testing.assert_allclose(there, -back, atol=1e-9)
    assert np.abs(there).max() > 0.1


def test_half_a_turn_goes_on_the_same_way_round_and_is_no_way_back(tmp_path):
    arm = crane(tmp_path)
    a, b = (arm.space.state({"lift": 0.1, "swing": swing, "out": 0.1, "tilt": 0.3}) for swing in (0.0, np.pi))
    assert motions(arm, joined(a, b), joined(b, a)).twins.tolist() == [0, 1]


def test_the_same_motion_again_is_looked_at_again(arm, ends):
    a, b = (states.take(slice(0, 1)) for states in ends)
    assert motions(arm, joined(a, a, b), joined(b, b, a)).twins.tolist() == [0, 1, 0]
