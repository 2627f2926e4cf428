"""Variants of worlds, laws and motions for nonlinear programs, whose solvers need derivatives; checks of criteria.

Only the programs use these approximations. The costs of a front are computed with the exact laws.

A program accepts smooth criteria, and counts of moves and turns.
"""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import instead_of_hinges, is_symbolic
from hpop.base.text import shown
from hpop.criteria.base import Criterion, check_command
from hpop.criteria.costs import motion_costs
from hpop.errors import OptionError, UnsupportedCriterion, did_you_mean
from hpop.models.rigid import PlanarLaw
from hpop.motions import LawDefaults, Motions, Phase, Rate, States
from hpop.motions.symbolic import SymbolicMotions, lift, sparse_lookup
from hpop.planners.programs import ONE_PROGRAM
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import LimitPassed
from hpop.world import World
from hpop.world.fields.field import Field, GridPoints
from hpop.world.fields.symbols import Quadratics
from hpop.world.ground import WHOLE, Heights

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

OPENBLAS = "libcasadi-tp-openblas.so.0"  # of CasADi's wheels for Linux
ROUNDING = 0.02  # rad: below this angle the timing of turns is smoothed


def require_ipopt(planner: str) -> None:
    """Raise OptionError if this installation of CasADi does not have IPOPT."""
    import casadi

    if not casadi.has_nlpsol("ipopt"):
        raise OptionError(
            f"{planner} needs the solver IPOPT, which this installation of CasADi does not have; install CasADi's own "
            "wheel (pip install --force-reinstall casadi), or use planner 'lattice'"
        )


def ipopt(name: str, program: dict[str, Any], options: dict[str, Any]) -> Any:
    """Return CasADi's solver by IPOPT for a nonlinear program, as :func:`casadi.nlpsol` does, held against Ctrl-C.

    The linear algebra of all such solvers then uses one thread: the matrices are so small that others only wait.
    """
    import casadi

    with interrupts_held():
        solver = casadi.nlpsol(name, "ipopt", program, options)
        _use_one_thread()
    return solver


@cache
def _use_one_thread() -> None:
    """Limit CasADi's own OpenBLAS to one thread, where its wheel has one; other copies of OpenBLAS stay as they are."""
    with suppress(OSError, AttributeError):  # other wheels of CasADi have other linear algebra
        loaded = ctypes.CDLL(OPENBLAS, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
        loaded.openblas_set_num_threads(1)


def vector(column: Column, size: int) -> Any:
    """Return a column of numbers or of CasADi symbols (SX, MX) as a CasADi vector (size,); one number is repeated."""
    import casadi

    if isinstance(column, int | float | np.ndarray | np.generic):
        return casadi.DM(np.broadcast_to(np.asarray(column, float), (size,)).copy())
    return casadi.vec(column.to_casadi() if hasattr(column, "to_casadi") else column)


class SparseField(Field):
    """Field that can be read at symbolic positions, with sparse derivatives.

    Its samples are computed only around the positions that are read.
    """

    @classmethod
    def of(cls, field: Field) -> Field:
        """Return a sparse field with the same samples as ``field``."""
        sparse = object.__new__(cls)
        sparse.__dict__.update({**field.__dict__, "_field": field, "_lookups": {}})
        return sparse

    def __call__(self, x: Column, y: Column) -> Column:
        """Return the values at positions, which are numbers or symbols."""
        return self._field(x, y) if not (is_symbolic(x) or is_symbolic(y)) else super().__call__(x, y)

    @property
    def _field(self) -> Field:
        field: Field = self.__dict__["_field"]
        return field

    @property
    def values(self) -> FloatArray:
        """All samples (H, W)."""
        return self._field.values

    def quadratics(self, places: FloatArray, out: FloatArray) -> None:
        """Write the expansions of the field about points (:meth:`hpop.world.fields.field.Field.quadratics`)."""
        self._field.quadratics(places, out)

    def at(self, places: GridPoints) -> Any:
        if places.points is None:
            return super().at(places)
        size, lookups = places.u.numel(), self.__dict__["_lookups"]
        with interrupts_held():
            if size not in lookups:  # stored, as CasADi holds no reference to Python callbacks
                callback = Quadratics(self._field, size)
                lookups[size] = sparse_lookup(callback, size), callback
            return lift(lookups[size][0](places.points).T, places.shape)


class SparseWorld(World):
    """World whose fields can be read at symbolic positions with sparse derivatives, for nonlinear programs.

    CasADi expressions that read a field need the field alive. This world stores its fields, so keep the world as long
    as a program that uses it.
    """

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        return self._sparse(("clearance", self.ground.layer(z)), World.clearance_field(self, z=z))

    def obstruction_field(self, radius: float, z: float = 0.0) -> Field:
        return self._sparse(("obstruction", radius, z), World.obstruction_field(self, radius, z))

    def field(self, name: str = "") -> Field:
        return self._sparse(("measured", name), World.field(self, name))

    def _sparse(self, key: tuple[Any, ...], field: Field) -> Field:
        fields: dict[tuple[Any, ...], Field] = self.__dict__.setdefault("_sparse_fields", {})
        if key not in fields:
            fields[key] = SparseField.of(field)
        return fields[key]


@dataclass(frozen=True)
class SmoothedTurn(LawDefaults):
    """Law of turns in place that are timed as if the angle were ``sqrt(θ² + ROUNDING²)`` instead of |θ|.

    A turn from rest to rest lasts 2 sqrt(|θ|/α), for an angular acceleration α. This function has a cusp at θ = 0,
    where solvers get stuck.
    """

    exact: PlanarLaw

    @property
    def kind(self) -> str:
        return self.exact.kind

    @property
    def varies(self) -> frozenset[str]:
        return self.exact.varies

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        turned = end.yaw - start.yaw
        yaw = start.yaw + np.sqrt(turned * turned + ROUNDING**2)
        return self.exact.phases(start, States(x=end.x, y=end.y, yaw=yaw))

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return self.exact.interpolate(name, start, end, share)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        return self.exact.travel(start, end, lever)

    def turned(self, start: States, end: States) -> Column:
        return self.exact.turned(start, end)


@dataclass(frozen=True, eq=False)
class _Moment(Motions):
    """Motions that return a rate at one moment in place of its maximum, so that a program can bound every sample.

    phase  index of the phase of the motion
    at     share of the duration of the phase
    """

    phase: int = 0
    at: float = 0.0

    def worst(self, rate: Rate, *, detail: float | None = None) -> Column:
        """Return the value of ``rate`` (M,) at the chosen moment of the M motions, instead of its maximum over time."""
        return rate(self._instants(self.phases[self.phase], self.at, None))


def moments(motions: Motions) -> list[Motions]:
    """Return copies of the motions, three for each phase: for its start, its middle and its end.

    Each copy has the motions unchanged, in full length. But where a criterion takes the maximum over a motion, a copy
    gives it the value at the moment of the copy. The end of a phase and the start of the next phase are two copies.
    """
    m = motions
    return [
        _Moment(m.world, m.model, m.law, m.start, m.end, panels=m.panels, phase=phase, at=at)
        for phase in range(len(m.phases))
        for at in (0.0, 0.5, 1.0)
    ]


# A hinge ``max(x, 0)`` has a kink, at which solvers get stuck. In an integral, as in ``∫ (|α| - threshold)₊ dt``, a
# hinge is replaced by a slack variable that is at least x and at least 0. The cost rises with the slack, so minimising
# presses the slack down to the larger of x and 0. A criterion permits this if it writes the hinge as
# :func:`hpop.base.math.hinge`.
#
# Where a maximum is bounded sample by sample, ``max(e, 0) <= z`` with z >= 0 is equivalent to ``e <= z``. The first has
# no gradient on one side: in the museum 11 of 15 bounds on the clearance did not converge; with the second, all did.


@dataclass(frozen=True)
class Slacks:
    """Slack variables that replace the hinges ``max(x, 0)`` in formulas of scalar symbols (SX).

    symbols  K slack variables, one for each hinge, in the order in which formulas are evaluated
    below    the x of each hinge: its slack must be at least x and at least 0
    """

    symbols: list[Any] = field(default_factory=list)
    below: list[Any] = field(default_factory=list)

    def take(self, column: Column) -> Column:
        """Return new slack variables (M,) in place of ``max(column, 0)``, and record them with their bounds."""
        import casadi

        below = casadi.vec(column.to_casadi())
        symbols = casadi.SX.sym("slack", below.numel())
        self.symbols.extend(casadi.vertsplit(symbols))
        self.below.extend(casadi.vertsplit(below))
        return lift(symbols, below.numel())


@contextmanager
def slackened() -> Iterator[Slacks]:
    """Replace each hinge ``max(x, 0)`` of formulas evaluated in this context by a slack; yield the collected slacks."""
    slacks = Slacks()
    token = instead_of_hinges.set(slacks.take)
    try:
        yield slacks
    finally:
        instead_of_hinges.reset(token)


def below_hinge(column: Any) -> Any:
    """Return e, as a column, if a CasADi vector has the form ``max(e, 0)``; return any other vector unchanged.

    Bounding e by a slack that is at least 0 is equivalent, and has a gradient everywhere.

    >>> import casadi
    >>> x = casadi.MX.sym("x", 3)
    >>> below_hinge(casadi.fmax(1 - x, 0)), below_hinge(casadi.sin(x))
    (MX((ones(3x1)-x)), MX(sin(x)))
    """
    import casadi

    op, shape = column.op(), column.shape
    if op in (casadi.OP_RESHAPE, casadi.OP_TRANSPOSE) and 1 in column.dep(0).shape:
        return casadi.vec(below_hinge(column.dep(0)))
    if op == casadi.OP_IF_ELSE_ZERO:
        below = below_hinge(column.dep(1))
        return casadi.if_else(column.dep(0), below, 0.0) if below.shape == column.dep(0).shape else column
    if op == casadi.OP_FMAX:
        for zero, inner in ((0, 1), (1, 0)):
            if column.dep(zero).is_zero() and column.dep(inner).shape == shape:
                return column.dep(inner)
    return column


def smooth_indices(criteria: Sequence[Criterion], problem: Problem, planner: str) -> tuple[int, ...]:
    """Return the indices of the smooth criteria (those with a gradient), and refuse criteria that programs cannot use.

    Raises UnsupportedCriterion for a criterion that has no gradient and does not just count moves and turns, for one
    whose formula fails on CasADi symbols, and if no criterion is smooth.
    """
    indices = tuple(j for j, criterion in enumerate(criteria) if criterion.smooth)
    for criterion in criteria:
        if not criterion.smooth and not is_counted(criterion, problem):
            raise UnsupportedCriterion(
                f"{planner} accepts smooth criteria, and criteria that only count moves and turns; "
                f"{criterion.name!r} has no gradient and is no such count. Leave it out, or use planner 'lattice'."
            )
    if not indices:
        raise UnsupportedCriterion(
            f"{planner} needs a smooth criterion to minimise, got only criteria without a gradient: "
            f"{', '.join(c.name for c in criteria)}. Add a smooth one, such as 'length'."
        )
    with ONE_PROGRAM:  # symbols are built here as well
        _try_on_symbols([criteria[j] for j in indices], problem)
    return indices


def _try_on_symbols(criteria: Sequence[Criterion], problem: Problem) -> None:
    """Evaluate the criteria on CasADi symbols; raise UnsupportedCriterion if one works on numbers only."""
    for motions in _some_motions(problem, 2):
        symbols = SymbolicMotions.of(motions).motions
        for criterion in criteria:
            on_symbols(criterion, symbols)


def minimised(name: str, criteria: Sequence[Criterion]) -> int:
    """Return the index of the criterion called ``name``, which a planner is to minimise.

    Raises OptionError if no criterion has this name, or if it has no gradient.
    """
    names = [criterion.name for criterion in criteria]
    smooth = [criterion.name for criterion in criteria if criterion.smooth]
    if name not in smooth:
        raise OptionError(
            f"minimise must be the name of a smooth criterion, got {shown(name)}.{did_you_mean(name, smooth)} "
            f"The smooth criteria here are {', '.join(smooth) or 'none'}"
        )
    return names.index(name)


def on_symbols(criterion: Criterion, motions: Motions) -> Any:
    """Return the costs (M,) of M symbolic motions as a CasADi vector.

    Raises UnsupportedCriterion if the criterion's ``cost`` fails on symbols.
    """
    try:
        column = vector(criterion.cost(motions), len(motions))
        if column.numel() != len(motions):
            raise ValueError(f"{column.numel()} costs for {len(motions)} motions")
    except LimitPassed:
        raise
    except UnsupportedCriterion as error:
        raise UnsupportedCriterion(f"criterion {criterion.name!r} cannot be used here: {error}") from None
    except Exception as error:  # a user's criterion on CasADi's symbols may raise anything
        why = (str(error).strip() or type(error).__name__).splitlines()[-1].rstrip(".")
        raise UnsupportedCriterion(
            f"criterion {criterion.name!r} must work on CasADi symbols, which nonlinear programs need, but failed: "
            f"{why}. In its `cost`, use NumPy functions of whole columns and no 'if' on values (check it with "
            f"`{check_command(criterion)}`), or use planner 'lattice'."
        ) from error
    return column


def is_counted(criterion: Criterion, problem: Problem) -> bool:
    """Return whether a criterion is a count: all moves cost the same, and so do all turns of more than three degrees.

    This is tested on 200 random motions of each kind, all over the map. The final check of the candidates finds any
    exceptions that this test misses.
    """
    if criterion.aggregate != "sum":
        return False
    return all(np.ptp(motion_costs(criterion, motions)) <= 1e-12 for motions in _some_motions(problem, 200))


def _some_motions(problem: Problem, count: int) -> tuple[Motions, Motions]:
    """Return ``count`` random moves, and as many random turns of more than three degrees, all over the map."""
    rng = np.random.default_rng(0)
    x_min, y_min, x_max, y_max = problem.world.bounds
    x, y = rng.uniform((x_min, y_min), (x_max, y_max), size=(count, 2)).T
    yaw, length = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.01, 5.0, count)
    angle = rng.uniform(math.radians(3.0), np.pi, count) * rng.choice([-1.0, 1.0], count)
    start = States(x=x, y=y, yaw=yaw)
    ahead = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw)
    turned = States(x=x, y=y, yaw=yaw + angle)
    world, model = problem.world.stand_in(SparseWorld), problem.model
    return (
        Motions(world, model, model.laws["move"], start, ahead),
        Motions(world, model, model.laws["turn"], start, turned),
    )
