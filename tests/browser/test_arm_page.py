"""The page of an arm: coal confirms its shapes and collisions; buttons, sliders and keys move the joints."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pytest
from playwright.sync_api import Page, expect

import hpop
from hpop.goals import Anywhere, LookAt
from hpop.models.serial_arm.judge import ArmJudge
from hpop.motions import States
from hpop.view import save_arm_page
from hpop.view.ride.page import body_of
from hpop.world import Box, Cylinder, Solid, World, pose_at
from hpop.world.geometry.solids import Hull, Sphere
from tests.models.serial_arm.arms import arm6, crane
from tests.two_arms import TABLE, two_arms

Open = Callable[..., Page]
START, MARKUP = (-0.27, 0.74, 1.73, 0.87, -0.05, -0.82), "<b>can</b>"
CAN = (0.7, 0.25, 0.43)
KEPT = 5e-4


def shelf() -> World:
    rng = np.random.default_rng(5)
    return World.from_solids(
        [
            Solid(Box((1.0, 1.4, 0.04)), pose_at((0.2, 0.0, -0.02)), "table"),
            Solid(Box((0.3, 1.0, 0.02)), pose_at((0.65, 0.0, 0.36), rpy=(0.0, 0.1, 0.2)), "board"),
            Solid(Cylinder(0.033, 0.115), pose_at(CAN, rpy=(0.4, 0.0, 0.0)), MARKUP),
            Solid(Sphere(0.1), pose_at((0.1, -0.6, 0.5)), "ball"),
            Solid(Hull(0.12 * rng.normal(size=(20, 3))), pose_at((-0.3, 0.5, 0.5)), "rock"),
        ]
    )


def shown(opened: Open, problem: hpop.Problem | hpop.SerialArm, folder: Path, **how: object) -> Page:
    page = opened(save_arm_page(problem, folder / "arm.html"), "#check", **how)
    page.wait_for_selector("html[data-ready]")
    return page


def geometry(solid: Solid) -> object:
    """Return the shape of a solid as coal has it."""
    match solid.shape:
        case Box(size=size):
            return coal.Box(*size)
        case Cylinder(radius=radius, length=length):
            return coal.Cylinder(radius, length)
        case Sphere(radius=radius):
            return coal.Sphere(radius)
    points = coal.StdVec_Vec3s()
    points.extend([*solid.shape.points])
    return coal.Convex.convexHull(points, True, "Qt")


def near(arm: hpop.SerialArm | hpop.MobileArm, world: World, state: States) -> dict[frozenset[str], float]:
    """Least distance, m, of each pair of links, or of a link and an obstacle, that must not touch, by coal."""
    placed = [
        (p.link, p.frame, geometry(p.solid), at[0]) for p, (_, at) in zip(arm.parts, arm.bodies(state), strict=True)
    ]
    things = [(solid.name, 0, geometry(solid), solid.pose) for solid in world.bodies]
    pairs = [
        (a, b) for a, b in combinations(placed, 2) if a[1] != b[1] and tuple(sorted((a[0], b[0]))) not in arm.apart
    ]
    found: dict[frozenset[str], float] = {}
    for a, b in [*pairs, *((a, b) for a in placed if a[1] for b in things)]:
        at = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for *_, pose in (a, b)]
        apart = coal.distance(a[2], at[0], b[2], at[1], coal.DistanceRequest(), coal.DistanceResult())
        names = frozenset((a[0], b[0]))
        found[names] = min(found.get(names, np.inf), apart)
    return found


@pytest.mark.cases("turning")
@pytest.mark.parametrize("kind", ["turning", "sliding"])
def test_what_the_page_calls_a_collision_is_nearer_than_half_a_millimetre_to_coal(
    opened: Open, tmp_path: Path, kind: str
) -> None:
    arm, world = (arm6() if kind == "turning" else crane(tmp_path, base=(0.2, 0.2, -0.7, 0, 0, 0))), shelf()
    start = tuple(np.clip(0.0, arm.chain.low, arm.chain.high).tolist())
    page = shown(opened, hpop.Problem(world, arm, start, start, ["duration"]), tmp_path, size=(300, 200))
    states = arm.space.sample(np.random.default_rng(3), 40)
    planned = arm.collision(world).states_free(states)
    collided = 0
    for i in range(states.size):
        state = states.take([i])
        page.evaluate("(q) => hpopArm.set(q)", [float(getattr(state, name)[0]) for name in arm.space.names])
        judged = page.evaluate("hpopArm.judge()")
        apart = near(arm, world, state)
        assert not any(abs(distance - KEPT) < 1e-5 for distance in apart.values())  # undecided for coal
        expected = {names for names, distance in apart.items() if distance < KEPT}
        assert {frozenset(pair) for pair in judged["collisions"]} == expected
        assert (not expected) == planned[i]
        collided += bool(expected)
        drawn = page.evaluate("hpopArm.drawn()")
        hit = {name for pair in expected for name in pair}
        owners = [*(part.link for part in arm.parts), *(solid.name for solid in world.bodies)]
        assert [one["red"] for one in drawn] == [name in hit for name in owners]
        if not expected:
            names = {solid.name for solid in world.bodies}
            least = min(distance for pair, distance in apart.items() if pair & names)
            assert judged["nearest"] == pytest.approx(least, rel=1e-3, abs=1e-5)
        for one, (shape, at) in zip(drawn, arm.bodies(state), strict=False):
            corners = body_of(shape).points @ at[0, :3, :3].T + at[0, :3, 3]
            assert np.allclose(one["low"], corners.min(axis=0), atol=3e-4)
            assert np.allclose(one["high"], corners.max(axis=0), atol=3e-4)
    assert 4 < collided < 38


@pytest.mark.proof
def test_padding_held_objects_and_kept_axes_count(opened: Open, tmp_path: Path) -> None:
    """The page counts padding as the planner does, and says when an orientation is not kept."""
    arm = arm6(
        padding={"hand": 0.05},
        attached=[{"name": "cup", "link": "hand", "sphere": 0.04, "position": [0, 0, 0.2]}],
        keep={"body": "tool", "axis": (0, 0, 1), "angle": (0.0, 1.5)},
    )
    world = shelf()
    page = shown(opened, hpop.Problem(world, arm, START, START, ["duration"]), tmp_path, size=(300, 200))
    states = arm.space.sample(np.random.default_rng(4), 80)
    judge = ArmJudge(arm.chain, arm.parts, arm.apart, world, library="coal")
    touching, planned = ~judge.states_free(states), arm.collision(world).states_free(states)
    tilts = np.arccos(np.clip(arm.pose("tool", states).up[2], -1.0, 1.0))
    for i in range(states.size):
        page.evaluate("(q) => hpopArm.set(q)", [float(getattr(states, name)[i]) for name in arm.space.names])
        judged = page.evaluate("hpopArm.judge()")
        assert (judged["tilted"] is None) == (tilts[i] <= 1.5)
        assert judged["tilted"] is None or judged["tilted"] == pytest.approx(tilts[i], abs=1e-6)
        assert judged["collisions"] or not touching[i]
        assert (not judged["collisions"] and judged["tilted"] is None) == planned[i]
    assert 5 < touching.sum() < 75


@pytest.mark.proof
def test_the_base_of_a_mobile_arm_moves_on_the_page_and_collides(opened: Open, tmp_path: Path) -> None:
    robot = hpop.MobileArm(arm6(base=(0.1, 0.0, 0.3, 0.0, 0.0, 0.0)))
    world = shelf()
    here = (-0.9, -0.6, 0.0, *arm6().space.named["home"])
    page = shown(opened, hpop.Problem(world, robot, here, here, ["duration"]), tmp_path, size=(300, 200))
    assert page.locator("#joints input[type=range]").count() == 9
    rng = np.random.default_rng(6)
    collided = 0
    for _ in range(25):
        row = (*rng.uniform(-1.2, 1.2, 2), *rng.uniform(-1.5, 1.5, 7))
        page.evaluate("(q) => hpopArm.set(q)", [*row])
        found = {frozenset(pair) for pair in page.evaluate("hpopArm.judge()")["collisions"]}
        apart = near(robot, world, robot.space.state(row))
        assert found == {names for names, distance in apart.items() if distance < KEPT}
        collided += any("mobile base" in pair for pair in found)
    assert 2 < collided < 24


@pytest.mark.proof
def test_two_arms_have_joints_of_both_on_the_page(opened: Open, tmp_path: Path) -> None:
    arms = two_arms(view=arm6(base=(0.3, 0.3, 0.0, 0.0, 0.0, -1.2)))
    page = shown(opened, hpop.Problem(TABLE, arms, "home", Anywhere(), ["rotation"]), tmp_path, size=(300, 200))
    assert page.locator("#joints input[type=range]").count() == 12
    copied = page.locator("label.values input").input_value()
    assert np.allclose(json.loads(copied), np.array(arms.view.space.named["home"], float), atol=1e-6)
    states = arms.space.sample(np.random.default_rng(8), 40)
    free, alone = arms.collision(TABLE).states_free(states), arms.view.collision(TABLE).states_free(arms.alone(states))
    assert (alone & ~free).any()
    assert free.any()
    work = arms.motion.states(states.time)
    for i in range(states.size):
        both = [*(getattr(states, name)[i] for name in arms.joints), *(getattr(work, name)[i] for name in work.names)]
        page.evaluate("(q) => hpopArm.set(q)", [float(value) for value in both])
        pairs = page.evaluate("hpopArm.judge()")["collisions"]
        assert (not pairs) == free[i]
        if alone[i]:
            assert all(sum(name.startswith("work/") for name in pair) == 1 for pair in pairs)


@pytest.fixture(scope="module")
def page(opened_once: Open, tmp_path_factory: pytest.TempPathFactory) -> Page:
    problem = hpop.Problem(shelf(), arm6(), START, LookAt(CAN, distance=(0.15, 0.3)), ["duration"])
    return shown(opened_once, problem, tmp_path_factory.mktemp("arm"))


@pytest.mark.proof
def test_buttons_and_keys_go_to_start_and_goals(page: Page) -> None:
    arm = arm6()
    page.keyboard.press("s")
    expect(page.locator("#said")).to_have_text("Start: free of collisions")
    assert page.evaluate("hpopArm.values()") == pytest.approx(START)
    assert page.get_by_role("button", name="Start", exact=True).get_attribute("aria-pressed") == "true"
    for number in (1, 2):
        page.keyboard.press("g")
        expect(page.locator("#said")).to_have_text(f"Goal {number}: free of collisions")
        pose = arm.pose("camera", arm.space.state(page.evaluate("hpopArm.values()")))
        towards = np.array(CAN) - [pose.x[0], pose.y[0], pose.z[0]]
        assert 0.15 - 1e-6 <= np.linalg.norm(towards) <= 0.3 + 1e-6
        assert np.allclose(towards / np.linalg.norm(towards), [axis[0] for axis in pose.ahead], atol=1e-5)
    page.get_by_role("button", name="home").click()
    assert page.evaluate("hpopArm.values()") == pytest.approx(arm.space.named["home"])
    assert page.locator(".values input").input_value().startswith("[")


def test_sliders_numbers_and_keys_move_a_joint_within_its_limits(page: Page) -> None:
    page.get_by_role("button", name="Start", exact=True).click()
    page.keyboard.press("2")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowLeft")
    assert page.evaluate("hpopArm.values()[1]") == pytest.approx(START[1] - np.radians(9))
    page.keyboard.press("End")
    high = arm6().chain.high[1]
    assert page.evaluate("hpopArm.values()[1]") == pytest.approx(high)
    page.keyboard.press("ArrowRight")
    assert page.evaluate("hpopArm.values()[1]") == pytest.approx(high)
    number = page.get_by_label("Value of base_to_shoulder")
    number.fill("30")
    number.press("Enter")
    assert page.evaluate("hpopArm.values()[0]") == pytest.approx(np.radians(30))
    number.fill("1e9")
    number.press("Enter")
    assert page.evaluate("hpopArm.values()[0]") == pytest.approx(arm6().chain.high[0])
    page.get_by_role("button", name="Show radians").click()
    assert float(number.input_value()) == pytest.approx(arm6().chain.high[0], abs=1e-4)
    page.get_by_role("button", name="Show degrees").click()


def test_a_collision_is_named_and_its_name_is_no_markup(page: Page) -> None:
    page.evaluate("hpopArm.set([0.3, 0.8, 0.9, 0, 0, 0])")
    said = page.locator("#verdict").inner_text()
    assert f"hand touches the obstacle {MARKUP}" in said
    assert page.locator("#verdict b").count() == 0
    page.evaluate("hpopArm.set([9, 0.8, 0.9, 0, 0, 0])")
    assert "joint base_to_shoulder is beyond its limits" in page.locator("#verdict").inner_text()


@pytest.mark.proof
def test_it_fits_a_phone(opened: Open, tmp_path: Path) -> None:
    phone = shown(opened, arm6(), tmp_path, size=(390, 844), has_touch=True)
    assert phone.evaluate("document.documentElement.scrollWidth") == 390
    for name in ("all 0", "home", "Camera’s view", "Help"):
        expect(phone.get_by_role("button", name=name)).to_be_in_viewport()
    phone.get_by_role("button", name="Help").click()
    expect(phone.get_by_text("The floor is no obstacle", exact=False)).to_be_visible()
    phone.keyboard.press("Escape")
    expect(phone.locator("#controls header")).to_contain_text("6 joints, no obstacles")
