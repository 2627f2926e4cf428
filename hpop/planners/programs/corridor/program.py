"""The convex program of a corridor: the best polyline with one segment in each region, for any weights of the costs.

It minimises ``Σ_j w_j f_j(v)`` over the vertices v. Each vertex lies in the overlap of the two regions whose segments
it joins. So both ends of a segment lie in a convex region, and hence the whole segment does. The weights are parameters
in the sense of disciplined parametrised programming (Agrawal et al. 2019), so the program is compiled only once.

The warm start is the polyline around which the regions were grown.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.criteria.convex import ConvexCost
from hpop.errors import CriterionError, OptionError
from hpop.models.collision.planar import TOUCH
from hpop.motions import States
from hpop.planners.programs.corridor.corridor import Corridor, HalfPlanes
from hpop.planners.programs.polyline import Polyline
from hpop.world import World
from hpop.world.geometry.planar import FreeSpace

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel

SHORTEST = 1e-3  # m: a shorter segment is left out
PIECE = 1.0  # m: distances are bounded piece by piece
FLAT = 1e-5  # share by which the weighted cost may rise when a small turn or segment is removed


@dataclass(frozen=True, eq=False)
class VariablePath:
    """Polyline whose vertices are variables of a convex program, as criteria need it for their convex form.

    The interface is :class:`hpop.criteria.base.ConvexPath`.

    vertices  cvxpy expression (n+1, 2), m
    """

    world: World
    model: PlanarModel
    corridor: Corridor
    vertices: Any

    @property
    def start(self) -> States:
        (x, y), yaw = self.corridor.warm.vertices[0], self.corridor.warm.start_yaw
        return States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw]))

    @property
    def length(self) -> Any:
        cvxpy = _cvxpy()
        return cvxpy.sum(cvxpy.norm(self.vertices[1:] - self.vertices[:-1], 2, axis=1))

    def shortfall(self, enough: float, space: FreeSpace, body: str) -> Any:
        from scipy.sparse import csr_array

        cvxpy = _cvxpy()
        # A body off the robot's axis may be nearer to an obstacle than the axis, by its distance from the axis. The
        # bound for a piece is largest at its ends, which are linear in the vertices: a piece is a fixed share of a
        # segment.
        at_origin = self.model.pose(body, States(x=np.zeros(1), y=np.zeros(1), yaw=np.zeros(1)))
        enough = enough + math.hypot(float(at_origin.x[0]), float(at_origin.y[0]))
        normals, shares, constants = [np.zeros((1, 2))], [np.zeros((1, self.corridor.segments + 1))], [np.zeros(1)]
        for i, (region, segment) in enumerate(zip(self.corridor.regions, self.corridor.warm_segments, strict=True)):
            ends = np.linspace(0.0, 1.0, 1 + max(1, math.ceil(math.dist(*segment) / PIECE)))
            for a, b in pairwise(ends):
                piece = np.array([segment[0] + s * (segment[1] - segment[0]) for s in (a, b)])
                outwards, offsets = region.distance_planes(space, piece, enough)
                for s in (a, b):
                    at = np.zeros((len(offsets), self.corridor.segments + 1))
                    at[:, i], at[:, i + 1] = 1.0 - s, s
                    normals.append(outwards)
                    shares.append(at)
                    constants.append(enough - offsets)
        x, y = (csr_array(np.concatenate(shares) * np.concatenate(normals)[:, [axis]]) for axis in (0, 1))
        return cvxpy.max(x @ self.vertices[:, 0] + y @ self.vertices[:, 1] + np.concatenate(constants))


@dataclass(eq=False)
class CorridorProgram:
    """Convex program of one corridor, with statistics of its solves.

    Its f variables z displace the vertices from those of the warm start: ``v = base + steps z``. There are two for each
    inner vertex, or one if a fixed heading at the start or goal keeps the vertex on a ray.

    criteria  k criteria with a method ``convex``
    solvers   names of solvers, in the order in which they are tried
    solved    number of programs that each solver solved
    failed    number of failed solves, by solver and reason
    """

    corridor: Corridor
    criteria: tuple[Criterion, ...]
    world: World
    model: PlanarModel
    solvers: tuple[str, ...]
    solved: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)

    @cached_property
    def rays(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Rays on which vertices must stay, by the index of the vertex: the origin of the ray, m, and its direction.

        The vertex after the start has one if the robot may not turn at the start; likewise the vertex before the goal.
        """
        warm, rays = self.corridor.warm, {}
        if self.corridor.along_first and self.corridor.segments > 1:
            rays[1] = (warm.vertices[0], _direction(warm.start_yaw))
        if self.corridor.along_last and self.corridor.segments > 1 and warm.goal_yaw is not None:
            rays[self.corridor.segments - 1] = (warm.vertices[-1], -_direction(warm.goal_yaw))
        return rays

    @cached_property
    def base(self) -> FloatArray:
        """Vertices (n+1, 2) of the warm start, m; if the start is the goal, this position twice."""
        warm = self.corridor.warm.vertices
        return warm if len(warm) > 1 else warm[[0, 0]]

    @cached_property
    def steps(self) -> FloatArray:
        """Derivatives (n+1, 2, f) of the vertices' coordinates by the f variables."""
        free = [] if self.corridor.is_fixed else list(range(1, self.corridor.segments))
        columns = []
        for i in free:
            for direction in [self.rays[i][1]] if i in self.rays else np.eye(2):
                column = np.zeros(self.base.shape)
                column[i] = direction
                columns.append(column)
        return np.stack(columns, axis=2) if columns else np.zeros((*self.base.shape, 0))

    @cached_property
    def _free(self) -> Any:
        return _cvxpy().Variable(self.steps.shape[2], name="steps")

    @cached_property
    def _weights(self) -> Any:
        return _cvxpy().Parameter(len(self.criteria), nonneg=True, name="weights")

    @cached_property
    def costs(self) -> tuple[ConvexCost, ...]:
        """Convex forms of the k criteria for this program's polyline.

        Raises CriterionError if a criterion's ``convex`` returns no convex scalar expression.
        """
        from scipy.sparse import csr_array

        cvxpy = _cvxpy()
        vertices = cvxpy.Constant(self.base)
        if not self.corridor.is_fixed:
            x, y = (self.base[:, axis] + csr_array(self.steps[:, axis]) @ self._free for axis in (0, 1))
            vertices = cvxpy.vstack([x, y]).T
        path = VariablePath(self.world, self.model, self.corridor, vertices)
        costs = []
        for criterion in self.criteria:
            cost = criterion.convex(path)  # type: ignore[misc]  # checked in `_convex`
            expression = cost.expression if isinstance(cost, ConvexCost) else None
            if not isinstance(expression, cvxpy.Expression) or expression.size != 1 or not expression.is_convex():
                raise CriterionError(
                    f"convex() of criterion {criterion.name!r} must return a ConvexCost whose expression is a scalar "
                    f"and convex by the rules of cvxpy, got {cost!r}; build it from cvxpy's convex functions, or "
                    "remove convex()"
                )
            costs.append(cost)
        return tuple(costs)

    @cached_property
    def problem(self) -> Any:
        """The program as a cvxpy problem, whose only parameters are the weights (k,)."""
        from scipy.sparse import csr_array

        cvxpy = _cvxpy()
        rows, limits = [], []
        for i, overlap in enumerate(self.corridor.overlaps, start=1):
            rows.append(overlap.normals @ self.steps[i])
            limits.append(overlap.offsets - overlap.normals @ self.base[i])
        for i, (end, direction) in self.rays.items():  # not behind the ray's end
            rows.append(-(direction @ self.steps[i])[None])
            limits.append(np.array([float(direction @ (self.base[i] - end))]))
        objective = sum(self._weights[j] * cost.expression for j, cost in enumerate(self.costs))
        within = csr_array(np.concatenate(rows)) @ self._free <= np.concatenate(limits)
        return cvxpy.Problem(cvxpy.Minimize(objective), [within])

    def compile(self) -> None:
        """Compile the program now instead of at the first solve."""
        if not self.corridor.is_fixed:
            self._weights.value = np.ones(len(self.criteria))
            with suppress(_cvxpy().SolverError):  # `solve` then tries the other solvers
                self.problem.get_problem_data(self.solvers[0])

    def evaluate(self, vertices: FloatArray) -> FloatArray:
        """Return the costs (k,) of a polyline with vertices (n+1, 2), as the program computes them."""
        if not self.corridor.is_fixed:
            self._free.value = np.einsum("vaf,va->f", self.steps, vertices - self.base)
        return np.array([float(np.squeeze(cost.expression.value)) for cost in self.costs])

    def solve(self, weights: FloatArray) -> FloatArray | None:
        """Return the vertices (n+1, 2) with the least weighted cost, or None if every solver fails.

        Solvers keep constraints approximately, so the vertices are moved exactly into the overlaps of regions.

        weights  (k,) positive, for costs in the criteria's units
        """
        cvxpy = _cvxpy()
        if self.corridor.is_fixed:
            return self.base
        # The objective is scaled to order one, as solvers' tolerances expect.
        self._weights.value = weights / max(float(weights @ self.evaluate(self.base)), 1e-12)
        for solver in self.solvers:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the status reports failures
                    self.problem.solve(solver=solver)
                status = str(self.problem.status)
            except cvxpy.SolverError as error:
                status = str(error).split(".")[0]
            if status == cvxpy.OPTIMAL:
                self.solved[solver] += 1
                return self._inside(self.base + self.steps @ self._free.value)
            self.failed[f"{solver}: {status}"] += 1
        return None

    def _inside(self, vertices: FloatArray) -> FloatArray:
        """Return vertices (n+1, 2), moved to the nearest allowed positions; solvers return them with small errors.

        An inner vertex is allowed in the overlap of the regions of its two segments. If the robot may not turn at the
        start, the vertex after the start must also lie on the ray from the start along the robot's heading there.
        Likewise, the vertex before the goal may have to lie on a ray from the goal, against the heading there.
        """
        moved = vertices.copy()
        for i, overlap in enumerate(self.corridor.overlaps, start=1):
            ray = self.rays.get(i)
            moved[i] = overlap.nearest(vertices[i]) if ray is None else _on_ray(overlap, vertices[i], *ray)
        return moved

    def tidied(self, vertices: FloatArray, weights: FloatArray) -> FloatArray:
        """Return vertices (n+1, 2) without negligible turns and very short segments, as far as the regions permit that.

        A vertex is moved only if the costs, weighted by ``weights`` (k,), hardly rise.
        """
        limit = float(weights @ self.evaluate(vertices))
        limit += FLAT * max(limit, 1e-12)
        for i in range(1, len(vertices) - 1):
            ray = self.rays.get(i)
            for position in self._simpler_positions(vertices, i) if ray is None else _near(vertices[i], ray[:1]):
                tried = vertices.copy()
                tried[i] = position
                within = self.corridor.overlaps[i - 1].excess(position[None])[0] <= 0.5 * TOUCH
                if within and weights @ self.evaluate(tried) <= limit:
                    vertices = tried
                    break
        return vertices

    def _simpler_positions(self, vertices: FloatArray, i: int) -> list[FloatArray]:
        """Return positions (2,) for vertex i at which a very short segment or a negligible turn would vanish."""
        positions = _near(vertices[i], [vertices[i - 1], vertices[-1]])
        before = next((v for v in vertices[i - 1 :: -1] if math.dist(v, vertices[i]) > 0), None)
        if before is None:
            return positions
        first, second = vertices[i] - before, vertices[i + 1] - vertices[i]
        if second.any() and abs(wrap(math.atan2(second[1], second[0]) - math.atan2(first[1], first[0]))) < LEAST_TURN:
            chord = vertices[i + 1] - before
            positions.append(before + chord * float(first @ chord) / float(chord @ chord))
        return positions

    def polyline(self, vertices: FloatArray) -> Polyline:
        """Return the polyline through vertices (n+1, 2), without zero-length segments and vertices without a turn."""
        apart, warm = np.hypot(*np.diff(vertices, axis=0).T) > 0, self.corridor.warm
        return Polyline(vertices[np.append(True, apart)], warm.start_yaw, warm.goal_yaw).simplified(1e-9)


def _cvxpy() -> Any:
    """Import cvxpy on first use and return it; the import takes seconds."""
    return import_module("cvxpy")


def solvers_from(first: str) -> tuple[str, ...]:
    """Return cvxpy's names of all installed solvers, beginning with ``first``; OptionError if that is not installed."""
    installed = _cvxpy().installed_solvers()
    if not isinstance(first, str) or first not in installed:
        raise OptionError(
            f"solver must be one of those that cvxpy finds installed ({', '.join(installed)}), got {shown(first)}. "
            "Install that solver, or take one of these."
        )
    return (first, *(name for name in installed if name != first))


def _direction(yaw: float) -> FloatArray:
    return np.array([math.cos(yaw), math.sin(yaw)])


def _on_ray(inside: HalfPlanes, point: FloatArray, end: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the point nearest to ``point`` on the part of a ray that lies inside half-planes.

    The ray begins at ``end`` and goes in a unit direction.
    """
    slope, room = inside.normals @ direction, inside.offsets - inside.normals @ end
    least = float(np.max(room[slope < 0] / slope[slope < 0], initial=0.0))
    most = float(np.min(room[slope > 0] / slope[slope > 0], initial=np.inf))
    return end + direction * max(least, min(most, float((point - end) @ direction)))


def _near(point: FloatArray, candidates: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the candidates that are less than SHORTEST away from a point, but not at it."""
    return [candidate for candidate in candidates if 0 < math.dist(point, candidate) < SHORTEST]
