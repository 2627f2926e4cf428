"""Formulas of one interval of a smoothing program: motion law, clearances and costs; and repair of points.

A hinge is a term ``max(x, 0)`` of a cost; the program has a slack variable for it, which is at least x and 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, simplefilter

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.criteria.base import Criterion
from hpop.models.driven import Drive, gauss
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.planners.needs import on_wheels
from hpop.planners.programs.nlp import Slacks, moments, on_symbols, slackened, vector
from hpop.planners.programs.smoothing.dose import Dose
from hpop.world.fields.symbols import looking
from hpop.world.ground import Heights

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from hpop.problems.problem import Problem

NODES = ("x", "y", "yaw", "speed", "turn_rate")
OWN = 2 * len(NODES) + 1  # variables of an interval without slacks
PANELS = 2  # panels into which an interval is split for the integrals of criteria


@dataclass(frozen=True)
class Forward(Drive):
    """Law of drives for use inside the program, without absolute values, whose kinks mislead solvers.

    The program keeps speeds from being negative, and the sign of the yaw rate fixed in each interval.

    sign  (M,) sign of the yaw rate in each interval
    """

    sign: Column = 1.0

    nodes = gauss(4)  # error 1e-6 for turns of a radian in an interval

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        if name not in ("x", "y"):
            return super().interpolate(name, start, end, share)
        # Position on the cubic that has the positions and velocities of both ends. The error is below 0.1 mm for a turn
        # of half a radian in half a metre.
        projection, span = np.cos if name == "x" else np.sin, getattr(end, name) - getattr(start, name)
        first, last = ((end.clock - start.clock) * at.speed * projection(at.yaw) for at in (start, end))
        bend = share * (1.0 - share) * ((1.0 - share) * (first - span) - share * (last - span))
        return getattr(start, name) + span * share + bend

    def travel(self, start: States, end: States, lever: Column) -> Column:
        length = 0.5 * (end.clock - start.clock) * (start.speed + end.speed)
        return length + lever * self.swept(start, end) if lever else length

    def swept(self, start: States, end: States) -> Column:
        return self.sign * self.turned(start, end)

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        turned = self.turned(start, end)
        return turned, 0.0 * turned


@dataclass(frozen=True, eq=False)
class Interval:
    """Nonlinear functions of one interval, as formulas of its own variables.

    The variables are the values at its first and last node, its duration, a slack for each hinge ``max(x, 0)`` in the
    costs, and the filter states of a dose at both nodes. Its parameter is the sign of the yaw rate.

    criteria  k criteria
    heights   height ranges with different obstacles
    shares    shares of the interval's time at which the clearance is sampled
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    heights: tuple[Heights, ...]
    shares: tuple[float, ...]

    @cached_property
    def dose(self) -> Dose | None:
        """Formulas of the criterion that is a dose, of which there may be one."""
        model = self.problem.model
        for criterion in self.criteria:
            if criterion.dose is not None:
                body, weighting = criterion.dose
                mount, names = model.mounts[body], model.space.names
                still, turning = (
                    States(**dict.fromkeys(names, np.zeros(1)) | {"yaw": np.full(1, w)}) for w in (0.0, 1.0)
                )
                turns = float(np.ravel(model.twist(body, still, turning).rotation[2])[0])
                return Dose(weighting, mount.ahead, mount.left, turns)
        return None

    @property
    def filters(self) -> int:
        """Number of filter states at each node."""
        return 0 if self.dose is None else self.dose.size

    @cached_property
    def hinges(self) -> int:
        """Number of hinges in the costs, each with a slack variable."""
        import casadi

        with looking():
            motions = self._motions(casadi.SX.sym("z", OWN), Forward(sign=lift(casadi.SX.sym("p"), 1)))
            return len(self._costs(motions)[1].below)

    def write(self, z: Any, p: Any) -> list[Any]:
        """Return the functions of the interval as columns of symbols (SX), for variables z and parameters p.

        The columns are the defects of the law (zero if the end follows from the start), the effort (squared
        accelerations), the costs of each criterion, and the clearances of each height range. A criterion that is a
        maximum has a cost for each sampled moment; of a dose, it is the square. If there is a dose, a column has the
        defects of its filter states. If there are hinges, a last column has the excess of each over its slack.
        """
        import casadi

        model, world, law = on_wheels(self.problem.model), self.problem.world, Forward(sign=lift(p, 1))
        motions = self._motions(z, law)
        start, end = motions.start, motions.end
        defects = [vector(law.defect(name, start, end), 1) for name in ("x", "y", "yaw")]
        gain, bend = (vector(getattr(end, name) - getattr(start, name), 1) for name in ("speed", "turn_rate"))
        effort = (gain**2 / model.acceleration**2 + bend**2 / model.turn_acceleration**2) / z[OWN - 1]
        positions = [[law.interpolate(axis, start, end, share) for axis in ("x", "y")] for share in self.shares]
        fields = [world.clearance_field(z=z) for z in self.heights]
        clear = [[vector(field(*position), 1) for position in positions] for field in fields]
        costs, slacks = self._costs(motions)
        filtered = self._filtered(z, costs)
        excess = [below - symbol for below, symbol in zip(slacks.below, slacks.symbols, strict=True)]
        groups = [_column(group) for group in (defects, [effort], *costs, *clear, *filtered, excess)]
        if not excess:
            return groups
        variables = casadi.vertsplit(z[OWN : z.numel() - 2 * self.filters], 1)
        if len(variables) != len(excess):  # CasADi crashes
            raise ValueError(
                f"an interval with {len(excess)} hinges needs {OWN + len(excess)} variables, got {z.numel()}; pass one "
                "slack for each hinge"
            )
        return list(casadi.substitute(groups, slacks.symbols, variables))

    def _motions(self, z: Any, law: Forward) -> Motions:
        duration = z[OWN - 1]
        start, end = (
            States(**{name: lift(z[first + i], 1) for i, name in enumerate(NODES)}, clock=lift(clock, 1))
            for first, clock in ((0, 0.0 * duration), (len(NODES), duration))
        )
        return Motions(self.problem.world, self.problem.model, law, start, end, panels=PANELS)

    def _costs(self, motions: Motions) -> tuple[list[list[Any]], Slacks]:
        with slackened() as slacks:
            costs = [
                []
                if criterion.dose is not None
                else [
                    on_symbols(criterion, m) for m in (moments(motions) if criterion.aggregate == "max" else [motions])
                ]
                for criterion in self.criteria
            ]
        return costs, slacks

    def _filtered(self, z: Any, costs: list[list[Any]]) -> list[list[Any]]:
        """Return the defects of the filter states in a list, and write the square of the dose into ``costs``."""
        if self.dose is None:
            return []
        place = next(j for j, criterion in enumerate(self.criteria) if criterion.dose is not None)
        first, speed, turn = z.numel() - 2 * self.filters, NODES.index("speed"), NODES.index("turn_rate")
        ends = (z[speed], z[len(NODES) + speed], z[turn], z[len(NODES) + turn], z[NODES.index("yaw")])
        states = z[first : first + self.filters], z[first + self.filters :]
        defects, square = self.dose.formulas(*states, ends, z[OWN - 1])
        costs[place].append(square)
        return [defects]


def _column(values: list[Any]) -> Any:
    import casadi

    return casadi.vertcat(*values)


# If the optimum lies in a flat valley, an interior-point method follows it for dozens of iterations, and each step
# violates curved limits slightly. So it is stopped as soon as the gradient is small and limits are violated by about a
# thousandth at most. A step of Newton's method squares this violation, so that one step is usually enough.


KEPT = 1e-7  # by how much a limit may be exceeded
STEPS = 5
LEAST = 1e-12  # on the diagonal, for redundant limits and limits without a free variable

Bounds = tuple[FloatArray, FloatArray]


def made_feasible(
    limits: Callable[[FloatArray], tuple[FloatArray, csr_array]], point: FloatArray, box: Bounds, bounds: Bounds
) -> FloatArray | None:
    """Move a point (d,) into the feasible set; return None if STEPS steps of Newton's method do not suffice.

    The result lies in the box, and exceeds no limit by more than KEPT. Newton's method solves for the equations and for
    all limits exceeded so far. Each step is the shortest one in a norm that weighs a variable the more, the nearer it
    is to an end of its range, so that it stays in its range.

    Parameters
    ----------
    limits : function that returns the m limited values and their sparse Jacobian (m, d) at a point
    point : (d,) in the box
    box : lower and upper bounds of the variables, (d,) each
    bounds : lower and upper bounds of the limited values, (m,) each

    >>> from scipy.sparse import csr_array
    >>> circle = lambda x: (np.array([x @ x]), csr_array(2 * x[None]))
    >>> wide, unit = np.full(2, np.inf), np.ones(1)
    >>> made_feasible(circle, np.array([0.61, 0.81]), (-wide, wide), (unit, unit)).round(3)
    array([0.602, 0.799])
    """
    from scipy.sparse import diags_array, eye_array
    from scipy.sparse.linalg import spsolve

    room = np.clip(np.minimum(point - box[0], box[1] - point), 0.0, 1.0)
    active = bounds[0] == bounds[1]
    for _ in range(STEPS):
        values, slopes = limits(point)
        off = values - np.clip(values, *bounds)
        if np.abs(off).max() <= KEPT:
            return point
        active |= off != 0.0
        across = slopes[np.flatnonzero(active)]
        normal = across @ diags_array(room) @ across.T + LEAST * eye_array(across.shape[0])
        with catch_warnings():
            simplefilter("ignore")  # a singular matrix shows in the result
            moved = spsolve(normal.tocsc(), off[active])
        if not np.isfinite(moved).all():
            return None
        point = np.clip(point - room * (across.T @ moved), *box)
    return None
