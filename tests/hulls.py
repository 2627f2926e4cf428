"""An oracle for supported points: linear programs in fractions, sharing nothing with the planners."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

Vector = tuple[int, ...]


class Hull:
    """conv(Y) of integer vectors, and conv(Y) + R^k_>=, decided exactly."""

    def inside(self, y: Sequence[int], points: Sequence[Vector]) -> bool:
        """Decide if y is in conv(points) + R^k_>=: the least t with (convex sum) <= y + t is not positive."""
        k = len(y)
        first = points[0]
        worst = max(range(k), key=lambda j: first[j] - y[j])
        if first[worst] <= y[worst]:
            return True
        # columns: lambda (one a point), s (k), t; rows: sum lambda p + s - t = y, then sum lambda = 1
        columns = [[*p, 1] for p in points] + [[int(i == j) for i in range(k + 1)] for j in range(k)]
        columns.append([-1] * k + [0])
        n = len(points)
        basis = [n + k if j == worst else n + j for j in range(k)] + [0]
        return minimum(columns, [*y, 1], [0] * (n + k) + [1], basis) <= 0

    def extreme(self, points: Sequence[Vector]) -> set[Vector]:
        """Vertices of conv(points) + R^k_>=."""
        distinct = sorted(set(points))
        return {y for y in distinct if len(distinct) == 1 or not self.inside(y, [p for p in distinct if p != y])}

    def supported(self, y: Vector, points: Sequence[Vector]) -> bool:
        """Decide if y of points is optimal for positive weights: nothing in conv(points) dominates it (Geoffrion)."""
        k = len(y)
        columns = [[*p, 1] for p in points] + [[int(i == j) for i in range(k + 1)] for j in range(k)]
        n = len(points)
        basis = [n + j for j in range(k)] + [list(points).index(y)]
        return minimum(columns, [*y, 1], [0] * n + [-1] * k, basis) >= 0


def minimum(columns: list[list[int]], right: list[int], costs: list[int], basis: list[int]) -> Fraction:
    """Least cost of a bounded linear program, by the simplex method with Bland's rule from a feasible basis."""
    m, n = len(right), len(columns)
    table = [[Fraction(columns[j][i]) for j in range(n)] + [Fraction(right[i])] for i in range(m)]

    def pivot(row: int, column: int) -> None:
        table[row] = [value / table[row][column] for value in table[row]]
        for i in range(m):
            if i != row and table[i][column]:
                factor = table[i][column]
                table[i] = [a - factor * b for a, b in zip(table[i], table[row], strict=True)]

    free = set(range(m))
    rows: dict[int, int] = {}
    for column in basis:
        row = next(i for i in sorted(free) if table[i][column])
        pivot(row, column)
        free.remove(row)
        rows[row] = column
    assert all(table[i][-1] >= 0 for i in range(m))
    while True:
        reduced = [costs[j] - sum(costs[rows[i]] * table[i][j] for i in range(m)) for j in range(n)]
        entering = next((j for j in range(n) if reduced[j] < 0), None)
        if entering is None:
            return sum((costs[rows[i]] * table[i][-1] for i in range(m)), Fraction(0))
        ratios = [(table[i][-1] / table[i][entering], rows[i], i) for i in range(m) if table[i][entering] > 0]
        leaving = min(ratios)[2]
        pivot(leaving, entering)
        rows[leaving] = entering
