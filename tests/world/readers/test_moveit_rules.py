"""Rules of a MoveIt scene for links: padding, scale and allowed contacts reach the arm's collision tests."""

import json
from dataclasses import replace

import fcl
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import hpop
from hpop.errors import MapError, ModelError
from hpop.models import SerialArm
from hpop.models.serial_arm.chain import ArmPart, enlarged_parts
from hpop.models.serial_arm.collision import KEPT
from hpop.scenario import load_scenario
from hpop.world import Box, Cylinder, Hull, Solid, Sphere, World, pose_at
from hpop.world.bodies import LinkRules
from tests.models.serial_arm.arms import CRANE, crane
from tests.models.serial_arm.cluttered import cluttered, pose, shape

BALL = {"id": "ball", "primitives": [{"type": "sphere", "dimensions": [0.1]}], "pose": {"position": [3, 0, 1.2]}}


def world_of(folder, *, things=(BALL,), **rules):
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"world": {"collision_objects": [*things]}, **rules}))  # YAML too
    return World.from_moveit_scene(path)


def gap(arm, state, world):
    """Return the distance of the crane's jib, a sphere 0.1 m before its frame, from the ball, by its own arithmetic."""
    frame = next(part for part in arm.parts if part.link == "jib")
    (at,) = (solid.pose[:3, 3] for solid in world.bodies)
    shown = [where for shape, where in arm.bodies(state) if isinstance(shape, Sphere)]
    assert isinstance(frame.solid.shape, Sphere)
    return float(np.linalg.norm(shown[0][0, :3, 3] - at)) - 0.03 - 0.1


@pytest.mark.parametrize("asked", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("by", ["scene", "option", "one link"])
def test_a_padded_link_keeps_the_padding_and_no_more(tmp_path, asked, by):
    given = {"option": {"padding": asked}, "one link": {"padding": {"jib": asked}}}.get(by, {})
    arm = crane(tmp_path, **given)
    state = arm.space.state((0.0, 0.3, 0.2, 0.0))
    hand = next(where[0, :3, 3] for s, where in arm.bodies(state) if isinstance(s, Sphere))
    rules = {"link_padding": [{"link_name": "jib", "padding": asked}]} if by == "scene" else {}
    outwards = np.array([np.cos(0.3), np.sin(0.3), 0.2]) / np.hypot(1.0, 0.2)
    for beyond, free in ((-1e-3, False), (1e-3, True)):
        away = hand + outwards * (0.03 + 0.1 + asked + KEPT + beyond)
        world = world_of(tmp_path, things=[BALL | {"pose": {"position": away.tolist()}}], **rules)
        assert gap(arm, state, world) == pytest.approx(asked + KEPT + beyond)
        assert arm.collision(world).states_free(state).tolist() == [free]
        assert arm.collision(world).clearance(state)[0] == pytest.approx(max(0.0, asked + KEPT + beyond), abs=1e-5)
        assert arm.judge(world).states_free(state).tolist() == [free]
    blocked = world_of(tmp_path, things=[BALL | {"pose": {"position": (hand + 0.12 * outwards).tolist()}}], **rules)
    assert "link 'jib'" in arm.collision(blocked).why_blocked(state)


def test_links_are_not_padded_against_each_other(tmp_path):
    arm, world = crane(tmp_path, padding=0.5), world_of(tmp_path)
    state = arm.space.state((0.0, 0.3, 0.2, 0.0))
    assert arm.collision(world).states_free(state)[0]
    assert arm.judge(world).states_free(state)[0]


@pytest.mark.seeds(3, of=40)
def test_states_are_free_as_python_fcl_says_of_padded_and_scaled_links(seed):
    """Shapes are enlarged here by the formulas of MoveIt; balls round hulls count as python-fcl's distance."""
    arm, rng = cluttered(seed), np.random.default_rng(seed)
    links = sorted({part.link for part in arm.parts})
    rules = LinkRules(
        {link: by for link in links if (by := rng.choice([0.0, 0.02, 0.1]))},
        {link: by for link in links if (by := rng.choice([0.5, 1.0, 1.5])) != 1.0},
        {("link2", "solid3"): True, ("link3", "solid4"): True},
    )
    arm = replace(arm, world=replace(arm.world, link_rules=rules))
    rows = rng.uniform(arm.chain.low, arm.chain.high, (60, len(arm.chain)))
    rows = rows[
        replace(arm, world=World.from_solids([Solid(Sphere(0.1), pose_at((90, 0, 0)))])).collision.states_free(
            arm.states(rows)
        )
    ]  # free of themselves
    frames, free = arm.judge._frames(rows), np.ones(len(rows), bool)
    for part in (part for part in arm.parts if part.frame):
        by, more = rules.scale.get(part.link, 1.0), rules.padding.get(part.link, 0.0)
        around = 0.0
        match part.solid.shape:
            case Box(size=size):
                one = fcl.Box(*(by * side + 2 * more for side in size))
            case Cylinder(radius=r, length=h):
                one = fcl.Cylinder(by * r + more, by * h + 2 * more)
            case Sphere(radius=r):
                one = fcl.Sphere(by * r + more)
            case Hull(points=points, triangles=faces):
                middle, around = points.mean(axis=0), more
                faces = np.column_stack([np.full(len(faces), 3), faces])
                one = fcl.Convex(middle + by * (points - middle), len(faces), faces.ravel())
        for solid in arm.world.bodies:
            if (part.link, solid.name) in rules.pairs:
                continue
            other = fcl.CollisionObject(geometry(solid), fcl.Transform(solid.pose[:3, :3], solid.pose[:3, 3]))
            for i, at in enumerate(frames[part.frame] @ part.solid.pose):
                mover = fcl.CollisionObject(one, fcl.Transform(at[:3, :3], at[:3, 3]))
                free[i] &= fcl.distance(mover, other, fcl.DistanceRequest(), fcl.DistanceResult()) - around > KEPT
    assert seed > 2 or 0 < free.sum() < free.size  # of some later seeds all states are alike
    assert arm.collision.states_free(arm.states(rows)).tolist() == free.tolist()


def geometry(solid):
    match solid.shape:
        case Box(size=size):
            return fcl.Box(*size)
        case Cylinder(radius=r, length=h):
            return fcl.Cylinder(r, h)
        case Sphere(radius=r):
            return fcl.Sphere(r)
    faces = np.column_stack([np.full(len(solid.shape.triangles), 3), solid.shape.triangles])
    return fcl.Convex(np.array(solid.shape.points), len(faces), faces.ravel())


@pytest.mark.seeds(4, of=40)
def test_an_enlarged_shape_contains_all_points_within_the_padding_of_the_scaled_one(seed):
    rng = np.random.default_rng(seed)
    part = ArmPart("hand", 1, Solid(shape(rng, 0.02, 0.3), pose(rng, 0.1)), 0.04)
    (larger,) = enlarged_parts([part], LinkRules(scale={"hand": 1.3})).values()
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    reach = larger.solid.shape.support(directions) + larger.padding
    middle = part.solid.shape.points.mean(axis=0) if isinstance(part.solid.shape, Hull) else np.zeros(3)
    scaled = directions @ middle + 1.3 * (part.solid.shape.support(directions) - directions @ middle)
    assert (reach >= scaled + 0.04 - 1e-12).all()


@pytest.mark.parametrize(
    ("matrix", "touches"),
    [
        ({}, False),
        ({"entry_names": ["ball", "jib"], "entry_values": [[False, True], [True, False]]}, True),
        ({"entry_names": ["ball", "jib"], "entry_values": [{"enabled": [False, True]}, {"enabled": [False] * 2}]},
         False),
        ({"default_entry_names": ["ball"], "default_entry_values": [True]}, True),
        ({"default_entry_names": ["ball", "jib"], "default_entry_values": [True, False]}, False),
        ({"entry_names": ["ball", "jib"], "entry_values": [[False, False], [False, False]],
          "default_entry_names": ["ball"], "default_entry_values": [True]}, False),
    ],
)  # fmt: skip
def test_the_matrix_says_which_link_may_touch_which_obstacle(tmp_path, matrix, touches):
    arm = crane(tmp_path)
    state = arm.space.state((0.0, 0.3, 0.2, 0.0))
    hand = next(where[0, :3, 3] for s, where in arm.bodies(state) if isinstance(s, Sphere))
    ball = BALL | {"pose": {"position": [*hand[:2], hand[2] + 0.12]}}
    world = world_of(tmp_path, things=[ball], allowed_collision_matrix=matrix)
    assert arm.collision(world).states_free(state).tolist() == [touches]
    assert arm.judge(world).states_free(state).tolist() == [touches]
    assert any("lets links touch obstacles" in note for note in world.notes) == bool(
        touches or any(matrix.get("default_entry_values", ()))
    )
    again = World.from_description(json.loads(json.dumps(replace(world).describe())))
    assert again.link_rules == world.link_rules


def test_the_matrix_decides_on_links_too_except_on_those_that_touch_by_design(tmp_path):
    """Boom and mast are joined; jib and mast are not, and the SRDF takes them out, which the scene takes back."""
    (tmp_path / "crane.srdf").write_text('<robot name="crane"><disable_collisions link1="mast" link2="jib"/></robot>')
    arm = crane(tmp_path, srdf=tmp_path / "crane.srdf")
    names = ["mast", "boom", "jib"]

    def apart(values):
        matrix = {"entry_names": names, "entry_values": values}
        return arm.collision(world_of(tmp_path, allowed_collision_matrix=matrix)).apart

    joined = {("boom", "mast"), ("boom", "jib"), ("mast", "rail")}
    assert arm.apart == joined | {("jib", "mast")}
    assert apart([[False] * 3] * 3) == joined
    assert apart([[True] * 3] * 3) == arm.apart


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        ({"link_padding": [{"link_name": "a", "padding": -0.1}]}, "padding must be a length in m from 0"),
        ({"link_padding": [{"padding": 0.1}]}, "link_name must be the name of a link; got None"),
        ({"link_scale": [{"link_name": "a", "scale": 0}]}, "scale must be a factor from 1e-06"),
        ({"allowed_collision_matrix": {"entry_names": ["a", "b"], "entry_values": [[True, True]]}},
         "a row of entry_values for each of its 2 entry_names, .* got 1 rows of 2 values"),
        ({"allowed_collision_matrix": {"entry_names": ["a"], "entry_values": [["yes"]]}}, "must be true or false"),
        ({"allowed_collision_matrix": {"default_entry_names": ["a"]}}, "got 1 names and 0 values"),
        ({"is_diff": True}, "must be a whole scene, but is a change of one .* /get_planning_scene"),
    ],
)  # fmt: skip
def test_rules_that_cannot_be_are_refused(tmp_path, rules, said):
    with pytest.raises(MapError, match=said):
        world_of(tmp_path, **rules)


@pytest.mark.parametrize(
    ("padding", "said"),
    [(-0.1, "padding must be a length in m from 0 to 10, got -0.1"), ({"jip": 0.1}, "got 'jip'; .* mean 'jib'"),
     ({"jib": 11}, "padding of jib must be a number from 0 to 10"), ("wide", "padding must be a length in m")],
)  # fmt: skip
def test_a_padding_that_cannot_be_is_refused(tmp_path, padding, said):
    with pytest.raises(ModelError, match=said):
        crane(tmp_path, padding=padding)


def test_an_arm_with_padding_is_described_with_it(tmp_path):
    (tmp_path / "crane.urdf").write_text(CRANE)
    arm = SerialArm.from_urdf(tmp_path / "crane.urdf", tip="eye", acceleration=2.0, padding={"jib": 0.02})
    assert arm.describe()["serial_arm"]["padding"] == {"jib": 0.02}
    assert "padding" not in crane(tmp_path).describe()["serial_arm"]
    assert SerialArm(**arm.describe()["serial_arm"]) == arm != crane(tmp_path)


def chained(*parents):
    return [
        {"child_frame_id": child, "header": {"frame_id": parent}, "transform": {"translation": at}}
        for child, parent, at in parents
    ]


def test_frames_are_followed_to_the_planning_frame(tmp_path):
    """One frame is the planning frame's equal, which used to count as another frame."""
    things = [
        BALL | {"id": f"in {frame}", "header": {"frame_id": frame}, "pose": {"position": [1, 0, 0]}}
        for frame in ("world", "cell", "desk", "same")
    ]
    frames = chained(
        ("desk", "cell", [0, 0, 2]),
        ("cell", "world", [0, 3, 0]),
        ("same", "world", [0, 0, 0]),
        ("world", "world", [0] * 3),
    )
    solids = world_of(tmp_path, things=things, fixed_frame_transforms=frames).bodies
    assert [solid.pose[:3, 3].tolist() for solid in solids] == [[1, 0, 0], [1, 3, 0], [1, 3, 2], [1, 0, 0]]


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        (chained(("a", "b", [1, 0, 0]), ("b", "a", [1, 0, 0])), "must lead from each frame to one planning frame, but"),
        (chained(("a", "a", [1, 0, 0])), "0 gives the pose of frame 'a' relative to itself"),
    ],
)
def test_frames_in_a_circle_are_refused(tmp_path, frames, said):
    with pytest.raises(MapError, match=said):
        world_of(tmp_path, fixed_frame_transforms=frames)


def test_padding_and_scale_of_links_that_the_robot_lacks_are_noted_in_a_front(tmp_path):
    padding = [{"link_name": name, "padding": by} for name, by in (("jibb", 0.1), ("jib", 0.1), ("finger", 0.0))]
    world = world_of(tmp_path, link_padding=padding, link_scale=[{"link_name": "lid", "scale": 1.1}])
    robots = [(crane(tmp_path), 2), (hpop.DifferentialDrive(), 3)]
    for model, count in robots:
        size = len(model.space.names)
        problem = hpop.Problem(world, model, (0,) * size, (0.1,) * size, ["duration"])
        (note,) = [note for note in problem.notes if "pads or scales" in note]
        assert note.startswith(
            f"the scene pads or scales {count} links that the robot does not have, to no effect: 'jib"
        )
        assert ("Did you mean 'jib'" in note) == (count == 2)


def test_names_in_a_matrix_that_are_neither_links_nor_obstacles_are_noted_in_a_front(tmp_path):
    names = ["jib", "ball", "bal", "trolly"]
    matrix = {"entry_names": names[:3], "entry_values": [[False] * 3] * 3}
    matrix |= {"default_entry_names": names, "default_entry_values": [True] * 4}
    arm = crane(tmp_path)

    def notes(**rules):
        problem = hpop.Problem(world_of(tmp_path, **rules), arm, (0,) * 4, (0.1,) * 4, ["duration"])
        return [note for note in problem.notes if "to no effect" in note]

    assert notes(allowed_collision_matrix=matrix) == [
        "the scene's allowed_collision_matrix has 2 names of neither a link of the robot nor an obstacle, to no "
        "effect: 'bal', 'trolly'. Did you mean 'ball'?"
    ]
    held = {"link_name": "jib", "object": BALL | {"id": "bal"}}
    right = {"default_entry_names": ["bal", "jib", "ball"], "default_entry_values": [True] * 3}
    assert notes(allowed_collision_matrix=right, robot_state={"attached_collision_objects": [held]}) == []


STOOD = {"lift": 0.31, "swing": -0.9, "out": 0.12, "tilt": 0.4, "wick": 0.7}
SQUARE = {"position": [0.3, -0.2, 0.1], "orientation": [0.1, -0.2, 0.3, 0.9]}


def in_frames(folder, *frames, state=STOOD, **rules):
    """Return a world with a box in each frame, named by it; all have the same pose there."""
    things = [
        {"id": f"in {frame}", "header": {"frame_id": frame}, "pose": SQUARE}
        | {"primitives": [{"type": "box", "dimensions": [0.1, 0.2, 0.3]}]}
        for frame in frames
    ]
    joints = {"joint_state": {"name": [*state], "position": [*state.values()]}}
    return world_of(folder, things=things, **{"robot_state": joints} | rules)


def crane_problem(folder, world, **parameters):
    return hpop.Problem(world, crane(folder, **parameters), (0, 0, 0, 0), (0.1, 0, 0, 0), ["duration"])


def test_objects_in_the_frame_of_a_link_stand_where_pinocchio_has_the_link(tmp_path):
    """Joints of the chain, one that the arm fixes at another value, and a root that the base moves."""
    base = (1.0, 2.0, 0.5, 0.1, -0.2, 2.5)
    model = pin.buildModelFromXML(CRANE)
    q = pin.neutral(model)
    for joint, value in STOOD.items():
        at = model.joints[model.getJointId(joint)]
        q[at.idx_q : at.idx_q + at.nq] = [np.cos(value), np.sin(value)] if at.nq == 2 else value
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    links = ("rail", "mast", "jib", "lamp")
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = Rotation.from_euler("xyz", base[3:]).as_matrix(), base[:3]
    within = np.eye(4)
    within[:3, :3], within[:3, 3] = Rotation.from_quat(SQUARE["orientation"]).as_matrix(), SQUARE["position"]
    expected = {f"in {link}": root @ data.oMf[model.getFrameId(link)].homogeneous @ within for link in links}
    world = in_frames(tmp_path, *links, "world", "cell", fixed_frame_transforms=chained(("cell", "world", [0, 0, 1])))
    problem = crane_problem(tmp_path, world, base=base)
    again = hpop.Problem.from_description(json.loads(json.dumps(problem.describe())))
    for found in (problem.world, again.world, crane(tmp_path, base=base).collision(world).world):
        placed = {solid.name: solid.pose for solid in found.bodies}
        for name, there in (expected | {"in world": within}).items():
            np.testing.assert_allclose(placed[name], there, atol=1e-12)
        np.testing.assert_allclose(placed["in cell"] - within, [[0] * 4, [0] * 4, [0, 0, 0, 1], [0] * 4], atol=1e-12)
        x0, y0, x1, y1 = found.bounds
        assert all(x0 < at[0, 3] < x1 and y0 < at[1, 3] < y1 for at in placed.values())
    said = [note for note in problem.world.notes if "in the scene's robot_state" in note]
    assert [link for link in links if any(f"'{link}'" in note for note in said)] == ["mast", "jib", "lamp"]
    assert any("gives objects in other frames than the world" in note for note in world.notes)
    assert not any("gives objects in other frames than the world" in note for note in problem.world.notes)


def test_objects_in_the_frame_of_a_moving_link_are_refused_unless_the_scene_says_where_it_was(tmp_path):
    lacking = {joint: value for joint, value in STOOD.items() if joint != "lift"}
    for world in (in_frames(tmp_path, "mast", state={}), in_frames(tmp_path, "rail", "mast", state=lacking)):
        with pytest.raises(MapError, match=r"'in mast' in the frame of the link 'mast', which moves\. If .* attach it"):
            crane_problem(tmp_path, world)
        with pytest.raises(MapError, match="which moves"):
            crane(tmp_path).judge(world)
    still = in_frames(tmp_path, "mast", state={})
    notes = crane(tmp_path, fixed={"lift": 0.2}).collision(still).world.notes
    assert not any("robot_state" in note for note in notes)
    (tmp_path / "plan.yaml").write_text(
        "world: {moveit_scene: {path: scene.yaml}}\nstart: [0, 0, 0, 0]\ngoal: [0.1, 0, 0, 0]\ncriteria: [duration]\n"
        "planner: roadmap\nmodel: {serial_arm: {urdf: crane.urdf, tip: eye, acceleration: 2}}\n"
    )
    with pytest.raises(MapError, match=r"line 1, world\.moveit_scene: the scene must give objects in the frame of"):
        load_scenario(tmp_path / "plan.yaml")
    mobile = hpop.MobileArm(crane(tmp_path), folded=(0, 0, 0, 0))
    with pytest.raises(MapError, match="the link 'rail', which moves"):
        hpop.Problem(in_frames(tmp_path, "rail"), mobile, (0, 0, 0, 0, 0, 0, 0), (1, 0, 0, 0, 0, 0, 0), ["duration"])


def test_frames_that_nothing_knows_are_noted_or_refused(tmp_path):
    world = in_frames(tmp_path, "rial", "rail")
    problem = crane_problem(tmp_path, world)
    assert any("'rial', which neither" in note and "Did you mean 'rail'?" in note for note in problem.world.notes)
    for frames in (("map", "odom"), ("world", "odom")):
        with pytest.raises(MapError, match=f"'in {frames[0]}' in frame .*'in odom' in frame 'odom', and neither"):
            crane_problem(tmp_path, in_frames(tmp_path, *frames))
    same = in_frames(tmp_path, "world")
    assert crane_problem(tmp_path, same).world.ground is same.ground


def test_objects_in_the_frame_of_another_object_stand_there(tmp_path):
    on = {"id": "on", "header": {"frame_id": "ball"}, "primitives": BALL["primitives"], "pose": SQUARE}
    ball, other = world_of(tmp_path, things=[BALL, on]).bodies
    np.testing.assert_allclose(other.pose[:3, 3] - ball.pose[:3, 3], SQUARE["position"])
    grown = {"world": {"collision_objects": [on | {"id": "ball", "operation": 2, "header": {"frame_id": "hand"}}]}}
    path = tmp_path / "changes.yaml"
    path.write_text(
        json.dumps({"world": {"collision_objects": [BALL]}}) + "\n---\n" + json.dumps(grown | {"is_diff": 1 > 0})
    )
    with pytest.raises(MapError, match="must be the frame of the object that it extends, ''; got 'hand'"):
        World.from_moveit_scene(path)


def test_joint_states_that_are_no_joint_states_are_refused_where_they_matter(tmp_path):
    with pytest.raises(MapError, match="must have a position for each name; got 0 for 1 names"):
        world_of(
            tmp_path, things=[BALL | {"header": {"frame_id": "jib"}}], robot_state={"joint_state": {"name": ["a"]}}
        )
    turned = {"transforms": [{"translation": [1, 0, 0]}], "joint_names": ["virtual"]}
    notes = world_of(tmp_path, robot_state={"multi_dof_joint_state": turned}).notes
    assert any("multi_dof_joint_state is not read; give the pose of the root link as base" in note for note in notes)


def test_misspelt_keys_in_the_parts_of_a_scene_are_noted(tmp_path):
    """They were dropped without a word, so that a pose was the identity, and an object not attached."""
    turned = BALL | {"header": {"frame": "cell"}, "pose": {"positon": [3, 0, 1.2]}}
    state = {"attached_collision_object": [{"link_name": "jib", "object": BALL}]}
    note = world_of(tmp_path, things=[turned], robot_state=state).notes[0]
    assert "parts of it have 'attached_collision_object', 'frame', 'positon', which is not read" in note
    assert all(f"Did you mean {key!r}?" in note for key in ("attached_collision_objects", "position"))
