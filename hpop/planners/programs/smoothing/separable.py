"""Nonlinear functions with equal formulas for each part of a program, and their exact sparse derivatives.

In a program over a trajectory, the parts are its intervals, and each depends on a dozen variables only. So the formulas
are written once, for one part, on CasADi's scalar symbols (SX), and differentiated there, without repeated operations
or operations on zeros. The same scalar operations are then applied to columns (MX) that have one entry for each part.
The Hessian of a smoothing program takes a seventh of the time of the Hessian that CasADi forms of the whole program. A
lookup is a value that the formulas read from a field, such as the distance to obstacles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.planners.programs import BUILDING, Deadline
from hpop.runtime.limits import check
from hpop.world.fields.symbols import Looks, Quadratics, looking

if TYPE_CHECKING:
    from hpop.world.fields.field import Field


SOME = 1000  # operations between two checks of the time
NODE = 1.2e-5  # s per node of an expression graph, to build a CasADi function


@dataclass(frozen=True, eq=False)
class Separable:
    """Functions of the n parts of a program, which have the same formulas for each part, with their derivatives.

    The functions form groups, such as costs or clearances. A group has m values for each part. All values are
    expressions (MX) of the program's variables (size,) and of the parts' parameters.

    symbols    (n, m) for each group: placeholders for its values in the formulas of a program
    values     (n, m) for each group: the values as expressions
    slopes     (n m, size) for each group: sparse Jacobian of vec(values)
    bends      CasADi function for the second derivatives: from x, p and multipliers (n, m) of each group to the upper
               triangle (size, size) of the sparse Hessian of the sum of all values times their multipliers
    callbacks  stored here because CasADi does not keep them alive
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
        """Return the functions of all parts, given the formulas of one.

        Parameters
        ----------
        write : returns the groups of values, as columns of SX, from the d variables and q parameters of a part
        where : (d, n) indices of each part's variables in the program's vector; parts may share variables
        x : the program's variables (size,), symbols
        p : the parts' parameters (n, q), symbols
        deadline : LimitPassed is raised after it
        """
        import casadi

        (d, n), size = where.shape, x.numel()
        part_x, part_p = casadi.SX.sym("x", d), casadi.SX.sym("p", p.size2())
        with looking() as looks:
            groups = [casadi.densify(group) for group in write(part_x, part_p)]
        deadline.check(BUILDING)
        y = casadi.vertcat(*groups)
        rates, numbers = casadi.SX.sym("rates", y.numel()), casadi.vertcat(*looks.numbers)
        jacobians: list[Any] = [casadi.jacobian(group, part_x) for group in groups]
        hessian: Any = casadi.triu(casadi.hessian(casadi.dot(rates, y), part_x)[0])

        deadline.check(BUILDING)
        columns = [[x[indices.tolist()] for indices in where], casadi.horzsplit(p)]
        fields = _Fields(looks, n)
        columns.append(fields.numbers([part_x, part_p], columns))
        mu = [casadi.MX.sym("mu", n, group.numel()) for group in groups]
        columns.append([column for group in mu for column in casadi.horzsplit(group)])
        parts = [*groups, *(casadi.vertcat(*slopes.nonzeros()) for slopes in (*jacobians, hessian))]
        nodes = sum(int(casadi.n_nodes(casadi.SX(part))) for part in parts)
        deadline.check(BUILDING, ahead=NODE * nodes)
        together = casadi.Function("part", [part_x, part_p, numbers, rates], parts, {"cse": True})
        *entries, bends = on_columns(together, columns, n)
        values, slopes = entries[: len(groups)], entries[len(groups) :]

        def matrix(slope: Any, jacobian: Any) -> Any:
            rows, variables = (np.array(index, dtype=np.int64) for index in jacobian.sparsity().get_triplet())
            return scattered(slope, rows[:, None] * n + np.arange(n), where[variables], (n * jacobian.size1(), size))

        of_pair = [np.array(index, dtype=np.int64) for index in hessian.sparsity().get_triplet()]
        pairs = [where[index] for index in of_pair]
        times = 1.0 + (
            (pairs[0] == pairs[1]) & (of_pair[0] != of_pair[1])[:, None]
        )  # entries below the diagonal count as well
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
        """Return a program for CasADi's solvers, and its derivatives as options of them.

        Objective and constraints are affine in x and in ``symbols``, which stand for the ``values`` of the functions.
        So the Jacobian of the constraints follows from the Jacobian of the values by constant factors. The Hessian is
        that of the sum of the values, each weighted by the derivative of the Lagrangian by this value.

        Parameters
        ----------
        x, p : variables and parameters of the program
        of_parts : the parameters of the parts, as in :meth:`of`
        objective, limits : objective and constraints as expressions of x, p and ``symbols``
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
    """Reader of the field values that the formulas look up, for all n parts together, with few calls per field."""

    def __init__(self, looks: Looks, n: int) -> None:
        self.callbacks: list[Any] = []
        self._looks, self._n = looks, n

    def numbers(self, variables: list[Any], columns: list[list[Any]]) -> list[Any]:
        """Return the values of all lookups in order, each as columns (n,) with an entry for each part.

        Lookups are read together, up to the first one whose position depends on the value of another one of them.
        """
        import casadi

        positions, symbols = self._looks.places, self._looks.numbers
        values: list[list[Any]] = []
        while len(values) < len(positions):
            begin = end = len(values)
            later = casadi.vertcat(*symbols[begin:])
            while end < len(positions) and (end == begin or not casadi.depends_on(positions[end], later)):
                end += 1
            inputs = [*columns, [column for numbers in values for column in numbers]]
            at = casadi.Function(
                "positions", [*variables, casadi.vertcat(*symbols[:begin])], [casadi.vertcat(*positions[begin:end])]
            )
            values += self._read(self._looks.fields[begin:end], casadi.horzsplit(on_columns(at, inputs, self._n)[0]))
        return [column for numbers in values for column in numbers]

    def _read(self, fields: list[Field], at: list[Any]) -> list[list[Any]]:
        """Return columns (n,) of values for each lookup; ``at`` has two columns of grid coordinates, u and v, for each.

        Lookups of the same field are read with one call.
        """
        import casadi

        n = self._n
        values: list[list[Any]] = [[] for _ in fields]
        for field in {id(field): field for field in fields}.values():
            mine = [k for k, looked_up in enumerate(fields) if looked_up is field]
            function = Quadratics(field, n * len(mine))
            self.callbacks.append(function)
            u, v = (casadi.vertcat(*(at[2 * k + axis] for k in mine)) for axis in (0, 1))
            numbers = casadi.horzsplit(function(casadi.horzcat(u, v).T).T)
            for i, k in enumerate(mine):
                values[k] = [number[i * n : (i + 1) * n] for number in numbers]
        return values


def on_columns(function: Any, columns: list[list[Any]], n: int) -> list[Any]:
    """Apply a CasADi function of scalars to columns (n,), row by row; return a matrix (n, m) for each of its outputs.

    columns : for each input of the function, the columns that replace its scalar entries
    """
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
        casadi.horzcat(*(entry if entry.numel() == n else casadi.repmat(entry, n, 1) for entry in result))
        for result in results
    ]


def scattered(
    entries: Any, rows: IntArray, columns: IntArray, shape: tuple[int, int], times: FloatArray | float = 1.0
) -> Any:
    """Return a sparse matrix with the entries (n, k) at rows and columns (k, n); entries at one position are added.

    times : (k, n) factors by which the entries are multiplied
    """
    import casadi

    if not rows.size:
        return casadi.MX(*shape)

    height, width = shape
    cells, which = np.unique((columns * height + rows).ravel(), return_inverse=True)
    starts = np.searchsorted(cells, height * np.arange(width + 1))
    sparsity = casadi.Sparsity(height, width, starts.tolist(), (cells % height).tolist())
    add = casadi.DM.triplet(
        which.ravel().tolist(),
        list(range(which.size)),
        casadi.DM(np.broadcast_to(times, rows.shape).ravel()),
        len(cells),
        which.size,
    )
    return casadi.MX(sparsity, casadi.mtimes(add, casadi.vec(entries)))
