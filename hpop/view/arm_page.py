"""Page of an arm: its collision shapes among the obstacles, with joints to move, and the bodies that collide.

It needs no network. Its view is drawn by three.js, as that of the ride. The page computes distances itself, by the
algorithm of :mod:`hpop.models.serial_arm.gjk` on the bodies and pairs of :class:`ArmCollision`, so it calls a state
free where the planner does. Tests compare both.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.files import replacing
from hpop.base.text import printable
from hpop.errors import HpopError, ModelError, OutputError
from hpop.models.serial_arm.collision import KEPT, ArmCollision
from hpop.models.serial_arm.keep import KeptAxis
from hpop.models.serial_arm.model import SerialArm
from hpop.models.serial_arm.scene import along_z
from hpop.motions.states import Values
from hpop.problems.problem import Problem
from hpop.view.marks import targets_by_name
from hpop.view.ride import surfaces
from hpop.view.ride.page import LINKS, body_of, licence
from hpop.view.ride.scene import colour_of
from hpop.view.single_page import page_file, single_page
from hpop.world import World
from hpop.world.geometry.solids import Shape

SCHEMA, VERSION = "hpop-arm", 1
DIGITS = 7
"""Decimals of the lengths, m, from which the page computes distances."""
SAMPLED, SHOWN = 100, 3
"""Number of random states of a goal that does not list its states, and how many of them the page shows at most."""


@checked_arguments
def save_arm_page(problem: Problem | SerialArm, path: str | os.PathLike[str] = "arm.html") -> Path:
    """Write a page on which an arm can be moved by its joints among the obstacles, and return its path.

    The page names and colours the pairs of bodies that collide. Buttons set start and goals of the problem, and the
    named states of the arm's SRDF. For an arm without a problem there are no obstacles.

    Parameters
    ----------
    problem : a problem whose model is an arm, or the arm alone
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


def arm_payload(problem: Problem | SerialArm) -> dict[str, Any]:
    """Return the data of the page: JSON, `hpop-arm` version 1, read by web/src/arm/model.ts."""
    if isinstance(problem, Problem):
        arm, world, targets = problem.model.carrier, problem.world, targets_by_name(problem)
    else:
        arm, world, targets = problem, World.from_solids([], extent=shapely.box(-1, -1, 1, 1)), []
    collision = arm.collision(world)
    if not isinstance(arm, SerialArm) or not isinstance(collision, ArmCollision):
        raise ModelError(
            f"this page shows one arm that does not drive, a serial_arm, got a {arm.name}; give its arm alone, or draw "
            "pictures by hpop look without --web"
        )
    states, notes = _states(problem) if isinstance(problem, Problem) else ({}, [])
    chain, space = arm.chain, arm.space
    named = {printable(name): values for name, values in space.named.items() if printable(name) not in states}
    rest = tuple(np.where(chain.low <= chain.high, np.clip(0.0, chain.low, chain.high), 0.0).tolist())
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "title": printable(Path(arm.urdf).stem),
        "joints": [
            {"name": printable(name), "sliding": sliding, "turning": turning, "low": low, "high": high}
            for name, sliding, turning, low, high in zip(
                chain.names,
                chain.sliding.tolist(),
                chain.turning.tolist(),
                chain.low.tolist(),
                chain.high.tolist(),
                strict=True,
            )
        ],
        "states": [
            {"name": name, "values": list(values)} for name, values in {**states, **named, "all 0": rest}.items()
        ],
        **_collision(collision),
        "camera": _mount(arm, "camera"),
        "tool": _mount(arm, "tool"),
        "kept": None if arm.kept is None else _kept(arm, arm.kept),
        "field_of_view": None if arm.field_of_view is None else list(arm.field_of_view),
        "targets": [{"name": printable(name), "place": list(place)} for name, place in targets],
        "surfaces": surfaces.description(),
        "notes": [printable(note) for note in (*world.notes, *arm.notes, *notes)],
        "licence": licence(),
    }


def _collision(collision: ArmCollision) -> dict[str, Any]:
    """Return frames, bodies and pairs of an arm's collision test as JSON; the last bodies are enlarged links."""
    scene, size = collision.scene, len(collision.parts)
    bodies = scene.bodies
    enlarged = {b: number for number, b in collision.enlarged_bodies.items()}
    shapes = list(_shapes(collision))
    described = [
        {
            "name": printable(shapes[enlarged.get(b, b)][0]),
            "link": b < size or b in enlarged,
            "shown": enlarged.get(b, b),
            "frame": int(frame),
            "points": bodies.points[bodies.first[b] : bodies.first[b + 1]].round(DIGITS).tolist(),
            "disc": float(bodies.disc[b]),
            "plane": bodies.plane[b].tolist(),
            "ball": float(bodies.ball[b]),
            "centre": bodies.centre[b].round(DIGITS).tolist(),
            "reach": float(bodies.reach[b]),
        }
        for b, frame in enumerate(scene.frames.tolist())
    ]
    return {
        "origins": scene.origins.tolist(),
        "bodies": described,
        "pairs": scene.pairs.tolist(),
        "kept_distance": KEPT,
        "shapes": [shape for _, shape in shapes],
    }


def _shapes(collision: ArmCollision) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and triangles of each body: links, then obstacles, each in the frame of its points."""
    turned = [np.eye(4), *map(along_z, collision.chain.axes)]
    links = list(dict.fromkeys(part.link for part in collision.parts))
    for part in collision.parts:
        colour = LINKS[links.index(part.link) % len(LINKS)]
        yield part.link, _drawn(part.solid.shape, turned[part.frame].T @ part.solid.pose, colour)
    for solid in collision.world.bodies:
        yield solid.name, _drawn(solid.shape, solid.pose, colour_of(solid.name))


def _drawn(shape: Shape, pose: FloatArray, colour: surfaces.Colour) -> dict[str, Any]:
    return body_of(shape, pose).description(0, colour)


def _mount(arm: SerialArm, body: str) -> dict[str, Any]:
    """Return the frame of the chain that carries a body, and the body's pose (3, 4) in it."""
    frame, pose = arm.chain.mounts[body]
    turned = along_z(arm.chain.axes[frame - 1]) if frame else np.eye(4)
    return {"frame": frame, "pose": (turned.T @ pose)[:3].tolist()}


def _kept(arm: SerialArm, kept: KeptAxis) -> dict[str, Any]:
    """Return the orientation that an arm keeps as JSON: axis of a body, its direction in the world, and the angle."""
    return {
        **_mount(arm, kept.of),
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
