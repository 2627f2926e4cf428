"""The view of a ride agrees with independently cast rays and with the renderer of pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from playwright.sync_api import Page

import hpop
from hpop.motions import States
from hpop.view import save_ride
from hpop.view.ride.panorama import Panorama
from hpop.view.ride.scene import ViewScene
from tests.browser.rides import front_of, horizon, problem_of, ready, room

Open = Callable[..., Page]
BEARINGS = 1024
POSES = 12
ARM = Path(__file__).parents[2] / "examples" / "arm"


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    return problem_of(room())


@pytest.fixture(scope="module")
def front(problem: hpop.Problem) -> hpop.Front:
    return front_of(problem)


@pytest.fixture(scope="module")
def page(opened_once: Open, problem: hpop.Problem, front: hpop.Front, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = save_ride(problem, front, tmp_path_factory.mktemp("ride") / "ride.html", rows=[1, 0])
    return ready(opened_once(path, "#check", size=(320, 240)))


def ride_to(page: Page, track: int, t: float) -> dict[str, list[float]]:
    return page.evaluate("([track, t]) => { hpopRide.at(track, t); return hpopRide.pose(); }", [track, t])


@pytest.mark.proof
def test_the_horizon_shows_what_rays_meet(page: Page, problem: hpop.Problem, front: hpop.Front) -> None:
    run = front.trajectories[1].execution()
    seen = set()
    for t in np.linspace(0.3, run.duration - 0.3, POSES):
        state = run.at(t)
        ride_to(page, 0, t)
        drawn = np.array(page.evaluate(f"hpopRide.numbers({BEARINGS}, 1, 512)"))
        there = horizon(problem.world, (state.x[0], state.y[0]), state.yaw[0], t, BEARINGS)
        assert np.mean(drawn == there) >= 0.995, t
        seen |= {*there.tolist()}
    assert seen == {1, 4, 5, 6, 7, 8, 9, 10}  # all but what is looked over, and under


def test_the_rig_is_where_the_executed_trajectory_has_the_camera(page: Page, front: hpop.Front) -> None:
    for track, row in enumerate([1, 0]):
        run = front.trajectories[row].execution()
        for t in [0.0, *np.linspace(0.0, run.duration, 7) * 0.97 + 0.013, run.duration]:
            pose = run.model.pose("camera", run.at(t))
            rig = ride_to(page, track, t)
            assert np.allclose(rig["position"], [pose.x[0], pose.y[0], np.broadcast_to(pose.z, 1)[0]], atol=1e-3)
            for axis in ("ahead", "left", "up"):
                there = [np.broadcast_to(column, 1)[0] for column in getattr(pose, axis)]
                assert np.allclose(rig[axis], there, atol=2e-3), (t, axis)


@pytest.mark.parametrize(
    ("width", "face", "moments"),
    [(256, 512, [0.35]), pytest.param(1024, 2048, np.linspace(0.05, 0.95, 6), marks=pytest.mark.proof)],
)
def test_it_shows_the_same_things_as_pictures_all_round(
    page: Page, problem: hpop.Problem, front: hpop.Front, width: int, face: int, moments: list[float]
) -> None:
    run, panorama = front.trajectories[1].execution(), Panorama(ViewScene.of(problem), width)
    for t in np.array(moments) * run.duration:
        state = run.at(t)
        ride_to(page, 0, t)
        drawn = np.array(page.evaluate(f"hpopRide.numbers({width}, {width // 2}, {face})")).reshape(-1, width)
        pictured = panorama.numbers(np.array([state.x[0], state.y[0], 1.2]), state.yaw[0], t)
        solid = (drawn > 0) | (pictured > 0)
        assert np.mean(drawn[solid] == pictured[solid]) >= 0.995
        assert np.mean(solid) > 0.2  # or next to nothing would be compared


@pytest.mark.proof
def test_an_arms_camera_turns_in_all_directions_and_its_links_go_with_it(opened: Open, tmp_path: Path) -> None:
    arm = hpop.SerialArm.from_urdf(ARM / "arm6.urdf", srdf=ARM / "arm6.srdf", tip="tool", acceleration=6.0)
    world = hpop.World.from_polygons([(shapely.box(0.6, -0.4, 0.9, 0.4), (0.0, 0.5))], extent=shapely.box(-2, -2, 2, 2))
    ends = np.array([[-0.27, 0.74, 1.73, 0.87, -0.05, -0.82], [0.9, 0.4, 1.2, -0.7, 0.8, 1.1]])
    states = States(**dict(zip(arm.space.names, ends.T, strict=True)))
    problem = hpop.Problem(world, arm, tuple(ends[0]), tuple(ends[1]), ["duration"])
    trajectory = hpop.Trajectory.through(arm, states)
    front = hpop.Front.of([[trajectory.duration]], [trajectory], names=["duration"], units=["s"])
    page = ready(opened(save_ride(problem, front, tmp_path / "arm.html", rows=[0]), "#check", size=(320, 240)))
    for t in np.linspace(0.0, trajectory.duration, 5):
        pose = arm.pose("camera", trajectory.at(t))
        rig = ride_to(page, 0, t)
        assert np.allclose(rig["position"], [pose.x[0], pose.y[0], pose.z[0]], atol=1e-3)
        for axis in ("ahead", "left", "up"):
            assert np.allclose(rig[axis], [column[0] for column in getattr(pose, axis)], atol=3e-3), (t, axis)
        links = page.evaluate("hpopRide.links()")
        placed = [poses[0] for _, poses in arm.bodies(trajectory.at(t))]
        assert len(links) == len(placed) > 5
        for link, there in zip(links, placed, strict=True):
            assert np.allclose(link["position"], there[:3, 3], atol=1e-3)
            assert np.allclose(link["ahead"], there[:3, 0], atol=5e-3)
            assert np.allclose(link["up"], there[:3, 2], atol=5e-3)
