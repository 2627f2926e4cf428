"""Two arms: where both are, how they move, what is proved of their distance, and motions that are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hpop
from hpop.base.registry import make_model
from hpop.criteria.base import make_criterion
from hpop.errors import CriterionError, ModelError
from hpop.models.serial_arm.laws import faults
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from tests.models.serial_arm.arms import arm6, crane
from tests.two_arms import BESIDE, TABLE, camera_at, shapes_at, share_done, sweep, tool_at, two_arms


def motions_of(arms, count, seed, reach=1.0):
    """Random motions of the viewing arm that begin at random times and take the least time, or longer."""
    rng = np.random.default_rng(seed)
    start = arms.space.sample(rng, count)
    end = {name: getattr(start, name) + reach * rng.uniform(-1, 1, count) for name in arms.joints}
    begin = rng.uniform(0, 0.8, count)
    columns = {
        name: np.clip(end[name], *bounds)
        for name, *bounds in zip(*(getattr(arms.view.space, part) for part in ("names", "low", "high")), strict=True)
    }
    start = States(**{**start.__dict__, "time": begin})
    end = States(**columns, pace=0.0 * begin, time=begin)
    (leg,) = arms.connect(start, end)
    later = States(**{**leg.end.__dict__, "time": leg.end.time + rng.uniform(0, 0.4, count)})
    return Motions(TABLE, arms, arms.law, start, later)


def at(motions, share):
    """Joint values (n,) of the viewing arm, and the time, after a share of the time of a single motion."""
    arm = motions.model.view
    (begin, end) = (np.array([float(getattr(s, name)[0]) for name in arm.joints]) for s in (motions.start, motions.end))
    done, _ = share_done(end - begin, arm.chain.speed, arm.chain.acceleration, np.array([share]))
    time = motions.start.time[0] + share * (motions.end.time[0] - motions.start.time[0])
    return begin + done[0] * (end - begin), float(time)


def working(arms, time):
    """Joint values of the working arm at a time, by linear interpolation between the given rows."""
    given = arms.motion.describe()
    return [np.interp(time, given["times"], column) for column in given["joints"].values()]


def test_both_arms_are_where_pinocchio_has_them():
    pytest.importorskip("pinocchio")
    arms = two_arms()
    states = arms.space.sample(np.random.default_rng(0), 40)
    for body in ("camera", "tool", "work_tool"):
        pose = arms.pose(body, states)
        for i in range(states.size):
            joints, time = [getattr(states, name)[i] for name in arms.joints], states.time[i]
            if body == "work_tool":
                truth = tool_at(working(arms, time))
            else:
                truth = camera_at(joints) if body == "camera" else tool_at(joints, BESIDE)
            assert np.allclose([pose.x[i], pose.y[i], pose.z[i]], truth[:3, 3], atol=1e-9)


def test_a_motion_begins_and_ends_in_time_and_keeps_its_limits():
    arms = two_arms()
    motions = motions_of(arms, 200, 1)
    start, end, law = motions.start, motions.end, arms.law
    assert np.allclose(motions.duration, end.time - start.time)
    chain = arms.view.chain
    assert not [*faults(chain, law, start, end, np.arange(200))]
    least = law.least(start, end)
    for i in range(0, 200, 10):
        one = Motions(TABLE, arms, law, start.take([i]), end.take([i]))
        way = np.array([(getattr(end, name) - getattr(start, name))[i] for name in arms.joints])
        assert share_done(way, chain.speed, chain.acceleration, np.zeros(1))[1] == pytest.approx(least[i], rel=1e-9)
        for u in (0.0, 0.1, 0.37, 0.5, 0.8, 1.0):
            for k, name in enumerate(arms.joints):
                share = np.array([u])
                assert law.interpolate(name, one.start, one.end, share)[0] == pytest.approx(at(one, u)[0][k], abs=1e-9)
                if 0 < u < 1:
                    step = np.array([1e-5])
                    ahead, back = (law.interpolate(name, one.start, one.end, share + s) for s in (step, -step))
                    slope, _ = law.slopes(name, one.start, one.end, share)
                    assert slope[0] == pytest.approx((ahead - back)[0] / 2e-5, abs=1e-4)
    early = States(**{**end.__dict__, "time": start.time + 0.9 * least})
    assert arms.doubtful(law, start, early).all()
    assert np.allclose(arms.connect(start, early)[0].end.time, start.time + least)


def test_a_part_of_a_motion_is_a_motion():
    """Cutting a trajectory at random times changes neither the states that it passes nor its costs."""
    arms = two_arms()
    motions = motions_of(arms, 12, 6)
    criteria = [make_criterion(c) for c in ("rotation", {"look_at": {"target": "work_tool"}}, "joint_energy")]
    rng = np.random.default_rng(7)
    for i in range(12):
        ends = [{n: getattr(s, n)[[i]] for n in arms.space.names} for s in (motions.start, motions.end)]
        whole = Trajectory(
            arms, States(**{n: np.concatenate([e[n] for e in ends]) for n in arms.space.names}), ("reach",)
        )
        times = np.sort(np.append(rng.uniform(0, whole.duration, 4), (0.0, whole.duration)))
        parts = Trajectory(arms, whole.at(times), ("reach",) * 5)
        every = np.linspace(0, whole.duration, 50)
        for name in arms.joints:
            assert np.allclose(getattr(parts.at(every), name), getattr(whole.at(every), name), atol=1e-7)
        for criterion in criteria:
            one, five = (sum(criterion.cost(m).sum() for _, m in way.batches(TABLE)) for way in (whole, parts))
            assert five == pytest.approx(one, rel=2e-3, abs=1e-6)


def test_a_wait_is_a_motion_that_only_takes_time():
    arms = two_arms()
    values = arms.space.values(arms.space.state("home", what="start"))
    states = States(
        **{name: np.full(2, v) for name, v in zip(arms.joints, values, strict=False)},
        pace=np.zeros(2),
        time=np.array([0, 0.5]),
    )
    way = Trajectory.through(arms, states)
    assert way.kinds == ("reach",)
    assert way.duration == pytest.approx(0.5)
    rotation, look = (make_criterion(c) for c in ("rotation", {"look_at": {"target": "work_tool"}}))
    ((_, motions),) = way.batches(TABLE)
    assert rotation.cost(motions)[0] == 0.0
    assert look.cost(motions)[0] > 0.1


@pytest.mark.proof
@pytest.mark.parametrize("criterion", ["look_at", "view_distance"])
def test_costs_of_a_moving_target_are_those_of_dense_samples(criterion):
    pytest.importorskip("pinocchio")
    arms = two_arms()
    motions = motions_of(arms, 25, 2)
    cost = make_criterion({criterion: {"target": "work_tool"}}).cost(motions)
    for i in range(25):
        one = Motions(TABLE, arms, arms.law, motions.start.take([i]), motions.end.take([i]))
        shares = np.linspace(0, 1, 401)
        rates = []
        for share in shares:
            joints, time = at(one, share)
            camera, tool = camera_at(joints), tool_at(working(arms, time))[:3, 3]
            off = tool - camera[:3, 3]
            ahead = np.arctan2(np.linalg.norm(np.cross(camera[:3, 0], off)), camera[:3, 0] @ off)
            distance = np.linalg.norm(off)
            rates.append(ahead if criterion == "look_at" else max(0.2 - distance, distance - 0.6, 0))
        truth = np.trapezoid(rates, shares) * one.duration[0]
        assert cost[i] == pytest.approx(truth, rel=3e-3, abs=2e-4)


@pytest.mark.proof
def test_the_occlusion_of_a_moving_tool_is_the_mean_of_that_of_a_tool_that_stands():
    """At 40 moments the working arm is frozen, with its tool as a fixed target; some links hide it at some of them."""
    arms, shares = two_arms(), []
    state = arms.space.state((1.936, 1.004, -1.284, -2.758, 0.633, -0.515), what="start")

    def hidden(each, target, lasts):
        wait = Motions(TABLE, each, each.law, state, States(**{**state.__dict__, "time": np.full(1, lasts)}))
        return float(make_criterion({"occlusion": {"target": target, "radius": 0.03}}).cost(wait)[0])

    for time in np.linspace(0, 2, 81)[1::2]:
        frozen = two_arms(view=arms.view, motion=sweep([working(arms, time)[:3]] * 2, (0, 1)))
        shares.append(hidden(frozen, tuple(tool_at(working(arms, time))[:3, 3].tolist()), 1.0))
    assert min(shares) < 0.1
    assert max(shares) > 0.9
    assert hidden(arms, "work_tool", 2.0) == pytest.approx(2.0 * np.mean(shares), abs=0.05)


def test_what_is_proved_free_is_free_by_pinocchio_and_coal_and_what_is_blocked_is_near():
    """40 states along each of 8 motions: no pair of shapes of the two arms nearer than 0.5 mm, and the reverse."""
    pytest.importorskip("pinocchio")
    coal = pytest.importorskip("coal")
    arms = two_arms(view=arm6(base=(0.1, 0.45, 0, 0, 0, -0.6)))
    base, motions = arms.view.base, motions_of(arms, 24, 3)
    alone = arms.view.collision(TABLE).motions_free(arms.motions_alone(motions))
    free, judged = arms.collision(TABLE).motions_free(motions), arms.judge(TABLE).motions_free(motions)
    assert not (free & ~judged).any()
    assert not (free & ~alone).any()
    request, seen = coal.DistanceRequest(), set()
    for i in (*np.flatnonzero(free)[:4], *np.flatnonzero(alone & ~free)[:4]):
        one, least = Motions(TABLE, arms, arms.law, motions.start.take([i]), motions.end.take([i])), np.inf
        for share in np.linspace(0, 1, 40):
            joints, time = at(one, share)
            for shape, pose in shapes_at(joints, base):
                for other, there in shapes_at(working(arms, time)):
                    if np.linalg.norm(pose.translation - there.translation) > 0.6 + min(least, 0.1):
                        continue
                    result = coal.DistanceResult()
                    least = min(least, coal.distance(
                        shape, coal.Transform3s(pose.rotation, pose.translation), other,
                        coal.Transform3s(there.rotation, there.translation), request, result))  # fmt: skip
        seen.add(bool(free[i]))
        assert least > 4.9e-4 if free[i] else least < 0.02
    assert seen == {True, False}


def test_states_in_contact_are_named():
    arms = two_arms(view=arm6(base=(0.5, 0.0, 0, 0, 0, np.pi)), motion=sweep([[0, 0.6, 1.2]] * 2, (0, 1)))
    state = arms.space.state((0, 0.6, 1.2, 0, 0, 0), what="start")
    assert not arms.collision(TABLE).states_free(state)[0]
    assert not arms.judge(TABLE).states_free(state)[0]
    assert "of the working arm at 0 s" in arms.collision(TABLE).why_blocked(state)


@pytest.mark.proof
def test_a_sliding_and_slanting_arm_is_placed_by_the_chain_through_both_as_by_its_own(tmp_path):
    """The working arm has sliding joints and no end stops; the proof reads its chain backwards, the judge forwards."""
    work = crane(tmp_path, base=(0.3, 0.1, -0.2, 0.1, 0.2, 0.3))
    rows = work.space.sample(np.random.default_rng(4), 5)
    given = {"times": [0, 0.4, 0.9, 1.5, 2.0], "joints": {name: getattr(rows, name) for name in work.joints}}
    arms = hpop.TwoArms(work, arm6(base=(0.6, 0.3, 0, 0, 0, 0)), given)
    motions = motions_of(arms, 150, 5, reach=0.5)
    free, judged = arms.collision(TABLE).motions_free(motions), arms.judge(TABLE).motions_free(motions)
    assert not (free & ~judged).any()
    assert (judged & ~free).sum() <= 4
    assert 10 < free.sum() < 140


def test_a_trajectory_a_file_and_a_table_are_one_motion(tmp_path):
    work = arm6()
    states = [work.space.state(name) for name in ("home", "ready")]
    way = Trajectory.through(work, States(**{n: np.concatenate([getattr(s, n) for s in states]) for n in work.joints}))
    arms = hpop.TwoArms(way, arm6(base=BESIDE))
    assert arms.motion.duration == pytest.approx(way.duration)
    times = np.linspace(0, way.duration, 333)
    off = [np.abs(getattr(arms.motion.states(times), name) - getattr(way.at(times), name)) for name in work.joints]
    assert np.max(off) < 1e-4
    way.table(0.01, body="joints").to_csv(tmp_path / "work.csv")
    (tmp_path / "work.csv").write_text("# a remark, as exports have it\n" + (tmp_path / "work.csv").read_text())
    read = hpop.TwoArms(work, arm6(base=BESIDE), tmp_path / "work.csv")
    assert read == arms
    assert make_model(json.loads(json.dumps(read.describe()))) == arms


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"motion": None}, "motion must be a trajectory of the working arm"),
        ({"motion": {**sweep(), "times": [0, 1, 1]}}, "the times of the motion must rise, but that of row 2"),
        ({"motion": {**sweep(), "times": [0, 1]}}, "as many rows as the times"),
        ({"motion": {**sweep(), "times": [0, 1, np.nan]}}, "one finite number for each row"),
        ({"motion": sweep([[0, 0, 0]], [0])}, "2 to 100,000 rows"),
        ({"motion": {"times": [0, 1], "joints": {"elbow": [0, 0]}}}, "must give the time t and the joints of the work"),
        ({"motion": sweep([[0, 9, 0]] * 3)}, "is at 9 in row 0 of its motion, beyond its limits"),
        ({"motion": "no such file.csv"}, "of the working arm from 'no such file.csv': No such file.*; check the path"),
        ({"view": arm6(velocity_scaling=[0.5, 1.0])}, "the viewing arm must have one velocity_scaling"),
        ({"step": 0}, "step must be a time in s"),
        ({"view": "arm"}, "view must be a serial arm"),
        ({"work": 7}, "work must be a serial arm"),
    ],
)
def test_refused(change, words):
    with pytest.raises(ModelError, match=words):
        two_arms(**change)


def test_a_file_without_rows_is_refused(tmp_path):
    (tmp_path / "work.csv").write_text("# nothing\n")
    with pytest.raises(ModelError, match=r"must give the time t and the joints of .*, got no columns"):
        two_arms(motion=tmp_path / "work.csv")


def test_a_trajectory_of_another_arm_is_refused():
    way = Trajectory.through(arm6(), arm6().space.state("home"))
    with pytest.raises(ModelError, match="motion is a trajectory of another arm"):
        two_arms(work=arm6(velocity_scaling=0.5), motion=way)
    with pytest.raises(ModelError, match="leave motion out"):
        two_arms(work=way)


def test_a_target_that_no_body_has_is_refused():
    criteria = [{"look_at": {"target": "work_tool"}}]
    with pytest.raises(CriterionError, match="requires work_tool"):
        hpop.Problem(TABLE, arm6(), "home", "ready", criteria)
    with pytest.raises(CriterionError, match="or the name of a body"):
        make_criterion({"look_at": {"target": 7}})
    assert hpop.Problem(TABLE, arm6(), "home", "ready", [{"look_at": {"target": "tool"}}])


def test_a_scene_that_attaches_objects_to_links_is_refused(tmp_path):
    """The links of both arms may have one name, so a scene does not say which arm holds its objects."""
    thing = {"id": "cup", "primitives": [{"type": "box", "dimensions": [0.05, 0.3, 0.05]}]}
    scene = {"robot_state": {"attached_collision_objects": [{"link_name": "tool", "object": thing}]}}
    block = {"id": "b", "primitives": [{"type": "box", "dimensions": [0.1] * 3}], "pose": {"position": [5, 5, 0]}}
    scene["world"] = {"collision_objects": [block]}
    (tmp_path / "scene.yaml").write_text(json.dumps(scene))
    world, arms = hpop.World.from_moveit_scene(tmp_path / "scene.yaml"), two_arms()
    with pytest.raises(ModelError, match=r"do not take the objects that a scene attaches to links \('cup'\)"):
        hpop.Problem(world, arms, "home", "home", ["duration"])
    scene = {"world": {"collision_objects": [block | {"header": {"frame_id": "tool"}}]}}
    (tmp_path / "scene.yaml").write_text(json.dumps(scene))
    with pytest.raises(ModelError, match=r"objects that a scene gives in the frame of a link \('b'\), since it does"):
        hpop.Problem(hpop.World.from_moveit_scene(tmp_path / "scene.yaml"), arms, "home", "home", ["duration"])
