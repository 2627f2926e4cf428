"""The example plugin's tracked vehicle: its boom camera follows a lift and a hinge, which hpop knows nothing of."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import models
from hpop.criteria.costs import trajectory_cost
from hpop.errors import ModelError
from hpop.motions import States
from hpop.problems.verify import verify
from hpop.testing import conformance
from hpop.trajectories.trajectory import Trajectory

PLUGIN = Path(__file__).resolve().parents[2] / "examples/plugin"
BEAM = hpop.World.from_polygons([(shapely.box(3.0, 0, 3.5, 4), (1.0, 3.0))], extent=shapely.box(0, 0, 7, 4))
"""A hall with a beam 1 m above the floor, below which the camera is while the lift is down."""


@pytest.fixture(scope="module")
def tracked() -> Iterator[Any]:
    """Its class, registered as an installed plugin's would be, for these tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PLUGIN))
        cls = importlib.import_module("hpop_example_plugin.tracked").Tracked
        models.add("tracked", cls)
        yield cls
    models._types.pop("tracked", None)


def test_it_passes_every_check(tracked: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hpop.testing.models.JUDGED", 30)
    monkeypatch.setattr("hpop.testing.models.PAIRS", 4)
    assert [check for check in conformance(tracked()) if check.fault] == []


def test_it_provides_what_its_joints_tracks_and_laws_say(tracked: Any) -> None:
    assert tracked().provides == {"base", "camera", "plane", "turn-move", "joints", "heading", "wheels"}
    assert tracked().joints == ("lift", "slew")


def test_the_front_of_a_lattice_goes_below_a_beam_with_its_lift_down(tracked: Any) -> None:
    model = tracked()
    problem = hpop.Problem(BEAM, model, (1, 2, 0, 0.8, 0), (6, 2, 0, 0.8, 0), ["duration", "rotation", "energy"])
    front = problem.solve(hpop.planners.Lattice(step=0.5, headings=4))
    assert front.status == "complete"
    assert verify(problem, front) == []
    for trajectory in front.trajectories:
        states = trajectory.at(np.linspace(0.0, trajectory.duration, 2000))
        camera = model.pose("camera", states)
        below = (camera.x > 3.0) & (camera.x < 3.5)
        assert below.any()
        assert camera.z[below].max() < 1.0
        assert {"lift"} <= set(trajectory.kinds)
    # 10 steps of 0.5 m at 0.8 m/s, and two lifts of 0.8 m: v/a + L/v at 0.2 m/s and 0.4 m/s², after 1 s of stopping
    quickest = front.costs[:, front.names.index("duration")].min()
    assert quickest == pytest.approx(5.0 / 0.8 + 2 * (0.8 / 0.2 + 0.2 / 0.4 + 0.8 / 0.8))


@pytest.mark.proof
def test_a_roadmap_of_its_configurations_goes_below_the_beam_too(tracked: Any) -> None:
    problem = hpop.Problem(BEAM, tracked(), (1, 2, 0, 0.8, 0), (6, 2, 0, 0.8, 0), ["duration", "rotation"])
    front = problem.solve({"roadmap": {"samples": 150, "seed": 0}})
    assert len(front)
    assert verify(problem, front) == []


def test_without_its_joints_moving_its_tracks_cost_as_much_as_the_wheels_of_a_differential_drive(tracked: Any) -> None:
    model = tracked()
    drive = hpop.DifferentialDrive(
        speed=model.speed, acceleration=model.acceleration, turn_rate=model.turn_rate,
        turn_acceleration=model.turn_acceleration, wheel_base=model.track_width,
    )  # fmt: skip
    poses = [(1, 1, 0), (2, 1, 0), (2, 3, math.pi / 2)]
    plain = Trajectory.from_poses(drive, poses)
    zero = np.zeros(len(plain) + 1)
    own = States(x=plain.states.x, y=plain.states.y, yaw=plain.states.yaw, lift=zero, slew=zero)
    energy = hpop.criteria.Energy()
    same = trajectory_cost(energy, Trajectory(model, own, plain.kinds), BEAM)
    assert same == pytest.approx(trajectory_cost(energy, plain, BEAM))


def test_people_keep_clear_of_all_that_its_boom_may_sweep(tracked: Any) -> None:
    assert max(part.reach for part in tracked(boom=0.6).platform) == pytest.approx(0.6, abs=5e-3)
    assert all(not part.on for part in tracked().platform)


def test_what_is_no_length_is_refused(tracked: Any) -> None:
    with pytest.raises(ModelError, match="boom must be a positive number, got -1"):
        tracked(boom=-1)
