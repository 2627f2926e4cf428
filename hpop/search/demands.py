"""What a search is asked beside all vectors: bounds on the costs, and how near to all others its front has to come."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hpop.base.options import MOST_COUNTED, amounts, whole
from hpop.base.text import shown
from hpop.errors import OptionError, did_you_mean
from hpop.search.graph import Graph
from hpop.search.machinery.approximation import ANYTHING, Precision
from hpop.search.networks import WHOLE


def bounds_of(graph: Graph, at_most: Any) -> tuple[int, ...]:
    """One bound a cost (k,), ANYTHING for none; empty if there are none at all."""
    given = _one_a_cost(graph, at_most, "at_most", "a whole number or None", None)
    name = f"at_most is a whole number or None for each of {graph.criteria} costs: a bound"
    first = "" if graph.edges is None else graph.edges.names[0]
    hint = f"or give bounds by name, in units, such as {{{first!r}: 30.0}}" * bool(first)
    bounds = tuple(ANYTHING if b is None else min(whole(name, b, 0, 2**63 - 1, hint=hint), ANYTHING) for b in given)
    return bounds if any(b < ANYTHING for b in bounds) else ()


def precision_of(graph: Graph, eps: float, tolerance: Any) -> Precision:
    """By a factor and a tolerance for each cost; raises OptionError for what is none."""
    return Precision(eps, _one_a_cost(graph, tolerance, "tolerance", "a whole number", 0))


def asked_in_words(graph: Graph, precision: Precision, at_most: tuple[int, ...]) -> str:
    """What was asked beside all vectors, as part of a certificate."""
    names = graph.edges.names if graph.edges is not None else [f"cost {j}" for j in range(graph.criteria)]
    quanta = graph.edges.quanta.tolist() if graph.edges is not None else [1] * graph.criteria
    steps, bounds = precision.of(range(graph.criteria)).tolist(), at_most or [ANYTHING] * graph.criteria
    near = [f"{n} {s * q:.9g}" for n, s, q in zip(names, steps, quanta, strict=True) if s]
    within = [f"{n} {b * q:.9g}" for n, b, q in zip(names, bounds, quanta, strict=True) if b < ANYTHING]
    return f" of at most {', '.join(within)}" * bool(within) + f" within a tolerance of {', '.join(near)}" * bool(near)


def _one_a_cost(graph: Graph, values: Any, name: str, kind: str, nothing: int | None) -> tuple[Any, ...]:
    """What is given for each cost, or for none of them, as counts; by name in units, ``nothing`` where not named."""
    if isinstance(values, Mapping):
        if graph.edges is None:
            raise OptionError(f"{name} is {kind} for each of {graph.criteria} costs: this graph's have no names")
        counts: dict[str, int | None] = dict.fromkeys(graph.edges.names, nothing)
        for cost, amount in amounts(name, values, MOST_COUNTED).items():
            if cost not in counts:
                known = ", ".join(counts)
                raise OptionError(f"{name} has {shown(cost)}; the costs are {known}.{did_you_mean(cost, counts)}")
            quantum = graph.edges.quanta[graph.edges.names.index(cost)]
            counts[cost] = min(math.floor(amount / quantum + WHOLE), 2**62)
        return tuple(counts.values())
    listed = isinstance(values, Sequence) and not isinstance(values, str)
    if not (listed or (isinstance(values, np.ndarray) and values.ndim)) or len(values) not in (0, graph.criteria):
        raise OptionError(f"{name} is {kind} for each of {graph.criteria} costs, got {shown(values)}")
    return tuple(values)
