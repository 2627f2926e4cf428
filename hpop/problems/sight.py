"""Notes on what is not seen: the target of a goal, from where trajectories end, and landmarks that are walled in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray
from hpop.base.text import some
from hpop.criteria.base import Criterion
from hpop.goals import Goal
from hpop.motions import Model, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Landmark
from hpop.world.geometry.rays_in_space import Surfaces, rows, surfaces_of, towards_ball

SEEN = 0.05  # m: radius of the ball about a target, of which some is to be seen
RAYS = 37


def notes_on_targets(world: World, model: Model, goal: Goal, trajectories: Sequence[Trajectory]) -> tuple[str, ...]:
    """Say from where trajectories end whose camera looks at a target that something hides."""
    looks = [(one, one.looked_at) for one in goal.alternatives() if one.looked_at is not None]
    if not looks or not len(trajectories):
        return ()
    names = model.space.names
    ends = States(**{name: np.array([getattr(t.states, name)[-1] for t in trajectories]) for name in names})
    notes = []
    for look, target in looks:
        there = look.reached(model, ends)
        hidden = there & _hidden(world, model, ends, target)
        if hidden.any():
            share = "" if hidden.sum() == there.sum() else f"{hidden.sum()} of {there.sum()} trajectories, by number "
            share += "" if not share else some([str(i) for i in np.flatnonzero(hidden).tolist()])
            x, y, z = target
            notes.append(
                f"the target ({x:g}, {y:g}, {z:g}) of look_at is hidden by an obstacle from where "
                f"{share or 'all trajectories'} end: check its place and height, or list the criterion 'occlusion'"
            )
    return tuple(notes)


def _hidden(world: World, model: Model, states: States, target: tuple[float, float, float]) -> BoolArray:
    """Whether cameras in states (N,) see nothing of a ball about a target, solids alone in the way."""
    pose = model.pose("camera", states)
    place = rows((pose.x, pose.y, pose.z), states.size)
    share = surfaces_of(world).blocked(
        Surfaces.of([]), np.empty((0, states.size, 4, 4)), place, *towards_ball(place, target, SEEN, RAYS)
    )
    return np.asarray(share >= 1.0 - 1e-9)


def notes_on_landmarks(world: World, model: Model, start: States, criteria: Iterable[Criterion]) -> tuple[str, ...]:
    """Say which landmarks nothing outside sees, as obstacles close about them; where criteria ask for landmarks."""
    if not world.content.landmarks or not any("landmarks" in criterion.requires for criterion in criteria):
        return ()
    pose = model.pose("camera", start)
    camera = tuple(float(np.ravel(column)[0]) for column in (pose.x, pose.y, pose.z))
    walled = [mark for mark in world.content.landmarks if _walled_in(world, mark, camera)]
    if not walled:
        return ()
    who = [f"{mark.name!r} at ({mark.x:.4g}, {mark.y:.4g})" for mark in walled]
    return (
        f"landmarks that are walled in, and seen from nowhere else: {some(who)}; obstacles close about them (a white "
        "letter on a dark pedestal is free ground within an obstacle): move them, or mend the map",
    )


def _walled_in(world: World, mark: Landmark, camera: tuple[float, ...]) -> bool:
    """Whether obstacles that hide at all heights between a landmark and a camera part the one's place from the other's.

    What contains the landmark hides nothing, so it is not walled in by that.
    """
    low, high = sorted((mark.z, camera[2]))
    if world.has_heights:
        solid: list[BaseGeometry] = [o.polygon for o in world.obstacles if o.z_min <= low and o.z_max >= high]
        raster = world.raster
        if raster is not None and raster.z_min <= low and raster.z_max >= high:
            solid.append(raster.solid())
        region = shapely.difference(world.extent, shapely.union_all(solid))
    else:
        region = world.ground.free_space((low, high)).region
    parts = shapely.get_parts(region)
    place, eye = shapely.Point(mark.x, mark.y), shapely.Point(camera[:2])
    own, other = (parts[shapely.intersects(parts, point)] for point in (place, eye))
    return bool(own.size and other.size) and not any(one.equals(two) for one in own for two in other)
