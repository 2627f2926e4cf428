"""Page of an arm: its collision shapes among the obstacles, with joints to move, and the bodies that collide.

It needs no network. Its view is drawn by three.js, as that of the ride. The page computes distances itself, by the
algorithm of :mod:`hpop.models.serial_arm.gjk` on the bodies and pairs of :class:`ArmCollision`, so it calls a state
free where the planner does. Tests compare both.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.files import replacing
from hpop.base.text import printable
from hpop.errors import HpopError, ModelError, OutputError
from hpop.models.mobile_arm import MobileArm
from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.models.serial_arm.collision import KEPT, ArmCollision
from hpop.models.serial_arm.keep import KeptAxis
from hpop.models.serial_arm.model import SerialArm
from hpop.models.serial_arm.scene import ArmScene, along_z, scene_of
from hpop.models.two_arms import TwoArms
from hpop.models.two_arms.collision import WORK
from hpop.motions import Model
from hpop.motions.states import Values
from hpop.problems.problem import Problem
from hpop.view.marks import targets_by_name
from hpop.view.ride import surfaces
from hpop.view.ride.page import LINKS, body_of, licence
from hpop.view.ride.scene import colour_of
from hpop.view.single_page import page_file, single_page
from hpop.world import World
from hpop.world.geometry.solids import Shape, Solid

SCHEMA, VERSION = "hpop-arm", 1
DIGITS = 7
"""Decimals of the lengths, m, from which the page computes distances."""
SAMPLED, SHOWN = 100, 3
"""Number of random states of a goal that does not list its states, and how many of them the page shows at most."""


@checked_arguments
def save_arm_page(
    problem: Problem | SerialArm | MobileArm | TwoArms, path: str | os.PathLike[str] = "arm.html"
) -> Path:
    """Write a page on which an arm can be moved by its joints among the obstacles, and return its path.

    The page names and colours the pairs of bodies that collide. Buttons set start and goals of the problem, and the
    named states of the arm's SRDF. For an arm without a problem there are no obstacles. The base of a mobile arm is
    moved by x, y and yaw. Of two arms, both have joints; contacts of the working arm with obstacles and with itself are
    not tested.

    Parameters
    ----------
    problem : a problem whose model is an arm, a mobile arm or two arms; or the model alone
    path : file of the page, which needs no other files; its folder is created if missing

    Raises ModelError if the robot is no arm, OptionError for a name that does not end in .html, OutputError if the page
    cannot be written; no partial file remains.
    """
    target = page_file(path)
    text = single_page("ride.js", "Arm", arm_payload(problem))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(text.encode())
    except OSError as error:
        raise OutputError(
            f"the page cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from None
    return target


def arm_payload(problem: Problem | SerialArm | MobileArm | TwoArms) -> dict[str, Any]:
    """Return the data of the page: JSON, `hpop-arm` version 1, read by web/src/arm/model.ts."""
    if isinstance(problem, Problem):
        robot, world, targets = problem.model.carrier, problem.world, targets_by_name(problem)
    else:
        robot, world, targets = problem, World.from_solids([], extent=shapely.box(-1, -1, 1, 1)), []
    arm, collision = _arm_of(robot, world)
    work = robot if isinstance(robot, TwoArms) else None
    states, notes = _states(problem) if isinstance(problem, Problem) else ({}, [])
    named = {printable(name): values for name, values in robot.space.named.items() if printable(name) not in states}
    joints = [*_joints(collision.chain, world), *([] if work is None else _joints(work.work.chain, world, WORK))]
    rest = [min(max(0.0, one["low"]), max(one["low"], one["high"])) for one in joints]
    placed = {name: _of_joints(values, work) for name, values in {**states, **named}.items()}
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "title": printable(Path(arm.urdf).stem),
        "joints": joints,
        "states": [{"name": name, "values": list(values)} for name, values in {**placed, "all 0": rest}.items()],
        **_collision(collision, work),
        "camera": _mount(collision.chain, "camera"),
        "tool": _mount(collision.chain, "tool"),
        "kept": None if arm.kept is None else _kept(collision.chain, arm.kept),
        "field_of_view": None if arm.field_of_view is None else list(arm.field_of_view),
        "targets": [{"name": printable(name), "place": list(place)} for name, place in targets],
        "surfaces": surfaces.description(),
        "notes": [printable(note) for note in (*world.notes, *robot.notes, *notes)],
        "licence": licence(),
    }


def _arm_of(robot: Model, world: World) -> tuple[SerialArm, ArmCollision]:
    """Return the arm that carries the camera and its collision test, in which the base of a mobile arm is a link."""
    if isinstance(robot, MobileArm):
        links = robot.collision(world).links
        return robot.arm, ArmCollision(links.chain, links.parts, links.apart, world)
    arm = robot.view if isinstance(robot, TwoArms) else robot
    if not isinstance(arm, SerialArm):
        raise ModelError(
            f"this page shows an arm: a serial_arm, a mobile_arm or two_arms, got a {robot.name}; draw pictures by "
            "hpop look without --web"
        )
    return arm, arm.collision(world)


def _joints(chain: Chain, world: World, prefix: str = "") -> list[dict[str, Any]]:
    """Return the joints of a chain as JSON; x and y of a base stay within the bounds of the world."""
    low, high = chain.low.copy(), chain.high.copy()
    on_base = np.flatnonzero(chain.sliding & np.isinf(chain.speed))
    if on_base.size:
        low[on_base], high[on_base] = np.reshape(world.extent.bounds, (2, 2))
    columns = chain.sliding.tolist(), chain.turning.tolist(), low.tolist(), high.tolist()
    return [
        {"name": printable(prefix + name), "sliding": sliding, "turning": turning, "low": least, "high": most}
        for name, sliding, turning, least, most in zip(chain.names, *columns, strict=True)
    ]


def _of_joints(values: Values, work: TwoArms | None) -> list[float]:
    """Return the values of all joints on the page in a state; those of a working arm follow from the state's time."""
    numbers = [0.0 if value is None else float(value) for value in values]
    if work is None:
        return numbers
    own = len(work.joints)
    at = work.motion.states(np.array([numbers[-1] if len(numbers) > own else 0.0]))
    return [*numbers[:own], *(float(getattr(at, name)[0]) for name in work.work.joints)]


def _collision(collision: ArmCollision, work: TwoArms | None) -> dict[str, Any]:
    """Return frames, bodies and pairs of a collision test as JSON.

    After links and obstacles follow the enlarged links, and then the links of a working arm, whose chain of frames
    begins in the world again.
    """
    scene, size, count = collision.scene, len(collision.parts), len(collision.chain)
    owners = [number for number, _ in sorted(collision.enlarged_bodies.items(), key=lambda item: item[1])]
    drawn = [*range(len(scene.frames) - len(owners)), *owners]
    shapes = [*_links(collision.chain, collision.parts), *map(_obstacle, collision.world.bodies)]
    bodies = [_body(scene, b, shapes[k][0], k, k < size) for b, k in enumerate(drawn)]
    origins, pairs, parents = scene.origins.tolist(), scene.pairs.tolist(), [*range(count)]
    if work is not None:
        other, chain, first = scene_of(work.work.chain, work.work.parts, ()), work.work.chain, len(shapes)
        shapes += [(WORK + name, shape) for name, shape in _links(chain, work.work.parts)]
        links = [_body(other, b, shapes[first + b][0], first + b, True) for b in range(len(other.frames))]
        bodies += [{**link, "frame": link["frame"] and link["frame"] + count} for link in links]
        pairs += [[a, b] for a in range(size) for b in range(len(drawn), len(bodies))]
        origins += other.origins.tolist()
        parents += [0, *range(count + 1, count + len(chain))]
    return {
        "origins": origins,
        "parents": parents,
        "bodies": bodies,
        "pairs": pairs,
        "kept_distance": KEPT,
        "shapes": [shape for _, shape in shapes],
    }


def _body(scene: ArmScene, b: int, name: str, shown: int, link: bool) -> dict[str, Any]:
    """Return body ``b`` of a scene as JSON.

    shown  number of the shape that is drawn for it
    link   whether it is a link of an arm, also an enlarged one, rather than an obstacle
    """
    bodies = scene.bodies
    return {
        "name": printable(name),
        "link": link,
        "shown": shown,
        "frame": int(scene.frames[b]),
        "points": bodies.points[bodies.first[b] : bodies.first[b + 1]].round(DIGITS).tolist(),
        "disc": float(bodies.disc[b]),
        "plane": bodies.plane[b].tolist(),
        "ball": float(bodies.ball[b]),
        "centre": bodies.centre[b].round(DIGITS).tolist(),
        "reach": float(bodies.reach[b]),
    }


def _links(chain: Chain, parts: Sequence[ArmPart]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and triangles of the links of a chain, each in the frame of its points."""
    turned = [np.eye(4), *map(along_z, chain.axes)]
    links = list(dict.fromkeys(part.link for part in parts))
    for part in parts:
        colour = LINKS[links.index(part.link) % len(LINKS)]
        yield part.link, _drawn(part.solid.shape, turned[part.frame].T @ part.solid.pose, colour)


def _obstacle(solid: Solid) -> tuple[str, dict[str, Any]]:
    return solid.name, _drawn(solid.shape, solid.pose, colour_of(solid.name))


def _drawn(shape: Shape, pose: FloatArray, colour: surfaces.Colour) -> dict[str, Any]:
    return body_of(shape, pose).description(0, colour)


def _mount(chain: Chain, body: str) -> dict[str, Any]:
    """Return the frame of the chain that carries a body, and the body's pose (3, 4) in it."""
    frame, pose = chain.mounts[body]
    turned = along_z(chain.axes[frame - 1]) if frame else np.eye(4)
    return {"frame": frame, "pose": (turned.T @ pose)[:3].tolist()}


def _kept(chain: Chain, kept: KeptAxis) -> dict[str, Any]:
    """Return the orientation that an arm keeps as JSON: axis of a body, its direction in the world, and the angle."""
    return {
        **_mount(chain, kept.of),
        "axis": list(kept.axis),
        "direction": list(kept.direction),
        "angle": list(kept.angle),
        "text": printable(str(kept)),
    }


def _states(problem: Problem) -> tuple[dict[str, Values], list[str]]:
    """Return start and goals of a problem by name, and notes. A goal that does not list its states is sampled."""
    space, target = problem.model.space, problem.target
    states: dict[str, Values] = {"start": problem.start}
    if target.listed:
        goals: list[Values] = [tuple(0.0 if value is None else value for value in goal) for goal in target.listed]
        return states | _numbered("goal", goals), []
    try:
        found = target.states(problem, np.random.default_rng(1), SAMPLED)
    except HpopError as error:
        return states, [f"no state of the goal was found: {error}"]
    free = problem.model.collision(problem.world).states_free(found)
    chosen = found.take(np.flatnonzero(free if free.any() else ~free)[:SHOWN])
    rows = np.stack([getattr(chosen, name) for name in space.names], axis=1)
    count = f"{free.sum()} of {found.size} samples are free" if free.any() else f"all {found.size} samples collide"
    note = f"the goal is a set of states, of which some samples are shown: {count}"
    return states | _numbered("goal", [tuple(row) for row in rows.tolist()]), [note]


def _numbered(name: str, states: list[Values]) -> dict[str, Values]:
    return {f"{name} {i}" if len(states) > 1 else name: values for i, values in enumerate(states, 1)}
