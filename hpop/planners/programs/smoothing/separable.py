"""Functions of one piece of a program, evaluated for all its pieces, with exact sparse derivatives.

A program over a trajectory is a sum over its intervals, and each interval knows a dozen variables only. So everything
nonlinear is written down once, for one interval, on CasADi's scalar symbols, and differentiated there: no operation on
a zero, none done twice. These scalar operations are then repeated on columns, one entry a piece. The Hessian of a
driven trajectory so costs a seventh of the one that CasADi takes of the whole program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.planners.programs.outcome import BUILDING, Deadline
from hpop.runtime.limits import check
from hpop.world.fields.symbols import Looks, Quadratics, looking

if TYPE_CHECKING:
    from hpop.world.fields.field import Field


SOME = 1000  # operations between two looks at the time
NODE = 1.2e-5  # s, that CasADi takes a node to make a function


@dataclass(frozen=True, eq=False)
class Separable:
    """Functions of d variables and q parameters, in groups, for each of n parts of a program.

    All are expressions (MX) of the program's variables and of the parts' parameters; group g has m values a part.

    symbols    (n, m) of each group: what stands for its values where a program is written down
    values     (n, m) of each group
    slopes     Jacobian (n m, size) of vec(values) of each group, sparse
    bends      CasADi function from x, p and multipliers (n, m) of each group to the upper triangle (size, size) of the
               Hessian of the sum of all values times their multipliers, sparse
    callbacks  what CasADi uses and does not keep alive
    """

    symbols: tuple[Any, ...]
    values: tuple[Any, ...]
    slopes: tuple[Any, ...]
    bends: Any
    callbacks: tuple[Any, ...]

    @classmethod
    def of(
        cls,
        write: Callable[[Any, Any], list[Any]],
        where: IntArray,
        x: Any,
        p: Any,
        deadline: Deadline = Deadline(),  # noqa: B008  (frozen)
    ) -> Separable:
        """All parts of one that is written down.

        Parameters
        ----------
        write : from the variables (d,) and parameters (q,) of a part to groups of values, columns of SX
        where : (d, n) places of each part's variables in the program's vector; two of them may be one
        x : the program's variables (size,), symbols
        p : the parts' parameters (n, q), symbols
        deadline : LimitPassed is raised where it is over
        """
        import casadi

        (d, n), size = where.shape, x.numel()
        one, given = casadi.SX.sym("x", d), casadi.SX.sym("p", p.size2())
        with looking() as looks:
            groups = [casadi.densify(group) for group in write(one, given)]
        deadline.check(BUILDING)
        y = casadi.vertcat(*groups)
        rates, numbers = casadi.SX.sym("rates", y.numel()), casadi.vertcat(*looks.numbers)
        jacobians: list[Any] = [casadi.jacobian(group, one) for group in groups]
        hessian: Any = casadi.triu(casadi.hessian(casadi.dot(rates, y), one)[0])

        deadline.check(BUILDING)
        columns = [[x[places.tolist()] for places in where], casadi.horzsplit(p)]
        fields = _Fields(looks, n)
        columns.append(fields.numbers([one, given], columns))
        mu = [casadi.MX.sym("mu", n, group.numel()) for group in groups]
        columns.append([column for group in mu for column in casadi.horzsplit(group)])
        parts = [*groups, *(casadi.vertcat(*slopes.nonzeros()) for slopes in (*jacobians, hessian))]
        nodes = sum(int(casadi.n_nodes(casadi.SX(part))) for part in parts)
        deadline.check(BUILDING, ahead=NODE * nodes)
        together = casadi.Function("part", [one, given, numbers, rates], parts, {"cse": True})
        *entries, bends = on_columns(together, columns, n)
        values, slopes = entries[: len(groups)], entries[len(groups) :]

        def matrix(slope: Any, jacobian: Any) -> Any:
            rows, variables = (np.array(index, dtype=np.int64) for index in jacobian.sparsity().get_triplet())
            return scattered(slope, rows[:, None] * n + np.arange(n), where[variables], (n * jacobian.size1(), size))

        of_pair = [np.array(index, dtype=np.int64) for index in hessian.sparsity().get_triplet()]
        pairs = [where[index] for index in of_pair]
        times = 1.0 + ((pairs[0] == pairs[1]) & (of_pair[0] != of_pair[1])[:, None])  # also from below the diagonal
        triangle = scattered(bends, np.minimum(*pairs), np.maximum(*pairs), (size, size), times)
        return cls(
            tuple(casadi.MX.sym("y", *group.shape) for group in values),
            tuple(values),
            tuple(matrix(*pair) for pair in zip(slopes, jacobians, strict=True)),
            casadi.Function("bends", [x, p, *mu], [triangle]),
            tuple(fields.callbacks),
        )

    def program(
        self, x: Any, p: Any, of_parts: Any, objective: Any, limits: Any
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """A program and its derivatives as options of CasADi's solvers.

        Objective and constraints are affine in x and in ``symbols``. So their Jacobian is that of the values times a
        constant, and their Hessian that of the values' sum, each times what a unit of it adds to the Lagrangian.

        Parameters
        ----------
        x, p : variables and parameters of the program
        of_parts : those among the parameters that the parts have
        objective, limits : in terms of x, p and ``symbols``
        """
        import casadi

        ys, inputs, names = list(self.symbols), [x, p], ["x", "p"]
        rate, rates = casadi.MX.sym("lam_f"), casadi.MX.sym("lam_g", limits.numel())
        mu = [casadi.gradient(rate * objective + casadi.dot(rates, limits), y) for y in ys]
        gradient, jacobian = casadi.gradient(objective, x), casadi.jacobian(limits, x)
        for y, slopes in zip(ys, self.slopes, strict=True):
            gradient += slopes.T @ casadi.vec(casadi.gradient(objective, y))
            jacobian += casadi.jacobian(limits, y) @ slopes
        f, g = casadi.substitute([objective, limits], ys, list(self.values))
        derivatives = {
            "grad_f": casadi.Function("grad_f", inputs, [f, gradient], names, ["f", "grad_f_x"]),
            "jac_g": casadi.Function("jac_g", inputs, [g, jacobian], names, ["g", "jac_g_x"]),
            "hess_lag": casadi.Function(
                "hess_lag",
                [*inputs, rate, rates],
                [self.bends(x, of_parts, *mu)],
                [*names, "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }
        return {"x": x, "p": p, "f": f, "g": g}, derivatives


class _Fields:
    """The numbers of all looks of all pieces, one call a field."""

    def __init__(self, looks: Looks, n: int) -> None:
        self.callbacks: list[Any] = []
        self._looks, self._n = looks, n

    def numbers(self, variables: list[Any], columns: list[list[Any]]) -> list[Any]:
        """The columns (n,) of the numbers of each look, one look after the other.

        Together are read all looks up to the first whose place depends on one of them.
        """
        import casadi

        places, known = self._looks.places, self._looks.numbers
        found: list[list[Any]] = []
        while len(found) < len(places):
            begin = end = len(found)
            later = casadi.vertcat(*known[begin:])
            while end < len(places) and (end == begin or not casadi.depends_on(places[end], later)):
                end += 1
            given = [*columns, [column for numbers in found for column in numbers]]
            at = casadi.Function(
                "places", [*variables, casadi.vertcat(*known[:begin])], [casadi.vertcat(*places[begin:end])]
            )
            found += self._read(self._looks.fields[begin:end], casadi.horzsplit(on_columns(at, given, self._n)[0]))
        return [column for numbers in found for column in numbers]

    def _read(self, fields: list[Field], at: list[Any]) -> list[list[Any]]:
        """The columns (n,) of the numbers of some looks, whose places are columns u and v in turns."""
        import casadi

        n = self._n
        found: list[list[Any]] = [[] for _ in fields]
        for field in {id(field): field for field in fields}.values():
            mine = [k for k, other in enumerate(fields) if other is field]
            function = Quadratics(field, n * len(mine))
            self.callbacks.append(function)
            u, v = (casadi.vertcat(*(at[2 * k + axis] for k in mine)) for axis in (0, 1))
            numbers = casadi.horzsplit(function(casadi.horzcat(u, v).T).T)
            for i, k in enumerate(mine):
                found[k] = [number[i * n : (i + 1) * n] for number in numbers]
        return found


def on_columns(function: Any, columns: list[list[Any]], n: int) -> list[Any]:
    """A function of scalars with a column (n,) in the place of each: results (n, outputs), one array an output."""
    import casadi

    work: dict[int, Any] = {}
    results: list[list[Any]] = [[None] * function.numel_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        if not k % SOME:
            check(BUILDING)
        operation, to, of = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if operation == casadi.OP_OUTPUT:
            results[to[0]][to[1]] = work[of[0]]
        elif operation == casadi.OP_INPUT:
            work[to[0]] = columns[of[0]][of[1]]
        elif operation == casadi.OP_CONST:
            work[to[0]] = casadi.MX(function.instruction_constant(k))
        elif len(of) == 1:
            work[to[0]] = casadi.MX.unary(operation, work[of[0]])
        else:
            work[to[0]] = casadi.MX.binary(operation, work[of[0]], work[of[1]])
    return [
        casadi.horzcat(*(one if one.numel() == n else casadi.repmat(one, n, 1) for one in result)) for result in results
    ]


def scattered(
    entries: Any, rows: IntArray, columns: IntArray, shape: tuple[int, int], times: FloatArray | float = 1.0
) -> Any:
    """A sparse matrix whose entries (n, k) stand at rows and columns (k, n); those at one place are added up.

    times : (k, n), how often each is added
    """
    import casadi

    if not rows.size:
        return casadi.MX(*shape)

    height, width = shape
    places, which = np.unique((columns * height + rows).ravel(), return_inverse=True)
    starts = np.searchsorted(places, height * np.arange(width + 1))
    sparsity = casadi.Sparsity(height, width, starts.tolist(), (places % height).tolist())
    add = casadi.DM.triplet(
        which.ravel().tolist(),
        list(range(which.size)),
        casadi.DM(np.broadcast_to(times, rows.shape).ravel()),
        len(places),
        which.size,
    )
    return casadi.MX(sparsity, casadi.mtimes(add, casadi.vec(entries)))
