"""The motions of all polylines of one structure, as its nonlinear program sees them: on symbols, and on numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.math import wrap
from hpop.models.rigid import PlanarLaw
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.planners.polylines.polyline import Polyline, PolylineStructure
from hpop.planners.programs.nlp import Rounded
from hpop.world import World

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@dataclass(frozen=True)
class Pieces:
    """Segments cut into pieces, K in all, and the turns between them."""

    structure: PolylineStructure

    @cached_property
    def owner(self) -> IntArray:
        """Segment (K,) of each piece."""
        return np.repeat(np.arange(self.structure.segments), np.array(self.structure.pieces, dtype=np.int64))

    @cached_property
    def shares(self) -> tuple[FloatArray, FloatArray]:
        """Matrices (K, n+1) that take vertices to where each piece begins and where it ends."""
        pieces, owner = np.array(self.structure.pieces, dtype=np.int64), self.owner
        total, count = len(owner), pieces[owner]
        place = np.arange(total) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        matrices = []
        for share in (place / count, (place + 1) / count):
            matrix = np.zeros((total, len(pieces) + 1))
            matrix[np.arange(total), owner] = 1.0 - share
            matrix[np.arange(total), owner + 1] += share
            matrices.append(matrix)
        return matrices[0], matrices[1]

    @cached_property
    def sampled(self) -> FloatArray:
        """Matrix (S, n+1) that takes vertices to where the clearance is bounded: ends and middles of pieces."""
        begin, end = self.shares
        return np.concatenate([begin[1:], (2 * begin + end) / 3, (begin + 2 * end) / 3])

    @property
    def turning(self) -> list[int]:
        """Vertices at which the robot turns."""
        return list(range(int(not self.structure.first_turn), self.structure.segments + self.structure.last_turn))

    def symbols(self, problem: Problem, world: World, x: Any, y: Any, yaws: Any) -> list[Motions]:
        """The pieces as moves and the turns, if there are any, on symbols.

        Parameters
        ----------
        x, y : (n+1,) of the vertices
        yaws : (2,) at start and goal
        """
        import casadi

        model, owner, n = problem.model, self.owner, self.structure.segments
        dx, dy = lift(x[1:] - x[:-1], n), lift(y[1:] - y[:-1], n)
        moves_at_all = dx * dx + dy * dy > 0
        yaw = casadi.MX(np.arctan2(np.where(moves_at_all, dy, 0.0), np.where(moves_at_all, dx, 1.0)))
        heading = lift(yaw[owner.tolist()], len(owner))
        corners = [lift(casadi.DM(m) @ c, len(owner)) for m in map(sparse, self.shares) for c in (x, y)]
        start = States(x=corners[0], y=corners[1], yaw=heading)
        end = States(x=corners[2], y=corners[3], yaw=heading)
        moves = Motions(world, model, model.laws["move"], start, end, panels=1)
        at = self.turning
        if not at:
            return [moves]
        before, after = (
            lift(column[at], len(at)) for column in (casadi.vertcat(yaws[0], yaw), casadi.vertcat(yaw, yaws[1]))
        )
        x, y = lift(x[at], len(at)), lift(y[at], len(at))
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [moves, Motions(world, model, Rounded(cast(PlanarLaw, model.laws["turn"])), start, end, panels=1)]

    def numbers(self, problem: Problem, polyline: Polyline) -> list[Motions]:
        """The same motions of one polyline, as criteria see them who report their cost."""
        return self.several(problem, polyline.vertices[None], polyline.start_yaw, polyline.goal_yaw)

    def several(
        self, problem: Problem, vertices: FloatArray, start_yaw: float, goal_yaw: float | None
    ) -> list[Motions]:
        """The motions of several polylines with vertices (b, n+1, 2): the moves of all, then the turns of all."""
        world, model = problem.world, problem.model
        ahead = np.diff(vertices, axis=1)
        headings = np.arctan2(ahead[..., 1], ahead[..., 0])  # (b, n)
        heading = headings[:, self.owner].ravel()
        start, end = (
            States(x=(vertices[..., 0] @ share.T).ravel(), y=(vertices[..., 1] @ share.T).ravel(), yaw=heading)
            for share in self.shares
        )
        moves = Motions(world, model, model.laws["move"], start, end)
        at = self.turning
        if not at:
            return [moves]
        every = np.ones((len(vertices), 1))
        first, last = start_yaw * every, (np.nan if goal_yaw is None else goal_yaw) * every
        before, after = np.hstack([first, headings])[:, at].ravel(), np.hstack([headings, last])[:, at].ravel()
        x, y = vertices[:, at, 0].ravel(), vertices[:, at, 1].ravel()
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [moves, Motions(world, model, model.laws["turn"], start, end)]


def sparse(matrix: FloatArray) -> Any:
    """A matrix without its zeros, for CasADi."""
    import casadi

    return casadi.sparsify(casadi.DM(matrix))
