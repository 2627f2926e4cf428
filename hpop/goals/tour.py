"""Tours: stops to visit between start and goal, in a given order, in any order, or in a partial order.

The progress of a tour is the set of its decided stops: the stops that were visited or skipped. Only some sets are
possible under a partial order (its order ideals). Here they are numbered and called layers, because a search has a copy
of its graph for each of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.text import counted, is_whole, python_value, shown
from hpop.errors import QueryError, did_you_mean
from hpop.goals.tour_stop import TourStop
from hpop.motions.laws import LONGEST

if TYPE_CHECKING:
    from hpop.motions import Model
    from hpop.world import World

MOST_STOPS = 60
MOST_LAYERS = 2**6  # sets of decided stops for which all states of stops are searched: six stops in any order
MOST_SETS = 2**12  # sets of decided stops of any tour, unless the order is given: twelve stops in any order
Order = Literal["given", "any"] | Sequence[tuple[int | str, int | str]]


class TourStep(NamedTuple):
    """Visit of a stop, as a step from one layer (set of decided stops) of a tour to another.

    stop     index of the visited stop
    layer    index of the layer after the visit
    skipped  indices of the optional stops that are skipped by this visit
    """

    stop: int
    layer: int
    skipped: tuple[int, ...]


@checked_arguments
@dataclass(frozen=True)
class Tour:
    """Stops to visit between start and goal.

    stops  stops, or mappings with their parameters: ``{"at": (6, 16), "within": 1.5, "dwell": 10}``,
           ``{"look_at": {"target": (22, 16, 1.5), "distance": (1, 2.5)}}``, ``{"landmark": "the vase"}``
    order  "given": as listed; "any": in any order; or pairs of stops, by index from 0 or by name, each of which says
           that the first stop comes before the second
    done   stops that were visited or skipped before, by index or name; a drive sets them. They count as neither visited
           nor missed any more

    Raises QueryError for invalid stops, equal names, an unknown stop in a pair, and pairs that contradict each other.

    >>> Tour([{"at": (6, 16), "within": 1}, {"at": (9, 2), "within": 1, "name": "exit"}], order="any").words
    'visiting stop 1 and exit in any order'
    """

    stops: tuple[TourStop, ...]
    order: Order = "given"
    done: tuple[int | str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.stops, str | Mapping) or not isinstance(self.stops, Sequence):
            raise QueryError(f"the stops of a tour must be a list of stops, got {shown(self.stops)}")
        if not 1 <= len(self.stops) <= MOST_STOPS:
            raise QueryError(
                f"a tour must have 1 to {MOST_STOPS} stops, got {len(self.stops)}; without any, leave it out"
            )
        stops = [TourStop.of(stop) for stop in self.stops]
        stops = [stop if stop.name else replace(stop, name=f"stop {i}") for i, stop in enumerate(stops, 1)]
        names = [stop.name for stop in stops]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise QueryError(
                f"each stop must have a name of its own, got {', '.join(map(repr, repeated))} more than once; give "
                "these stops different names"
            )
        if (total := sum(stop.dwell for stop in stops)) > LONGEST:
            raise QueryError(
                f"the dwells of a tour may be {LONGEST:,.0f} s at most in all, got {total:,.6g} s; shorten some of them"
            )
        object.__setattr__(self, "stops", tuple(stops))
        object.__setattr__(self, "order", self._checked_order())
        object.__setattr__(self, "done", tuple(sorted({self._index(stop, "done") for stop in self.done})))
        _ = self.layers

    @classmethod
    def of(cls, spec: Any) -> Tour:
        """Build a tour from a mapping with ``stops``, optionally ``order`` or ``some`` (pairs), and ``done``.

        A :class:`Tour` is returned as it is.
        """
        if isinstance(spec, Tour):
            return spec
        if not isinstance(spec, Mapping) or not {"stops"} <= set(spec) <= {"stops", "order", "some", "done"}:
            raise QueryError(
                "a tour must be an hpop.Tour, or a mapping with stops and optionally order (given or any) or some "
                f"(pairs of stops), got {shown(spec)}"
            )
        if "order" in spec and "some" in spec:
            raise QueryError("a tour must have order or some, got both; some is an order itself: leave order out")
        return cls(spec["stops"], spec.get("some", spec.get("order", "given")), spec.get("done", ()))

    def on(self, model: Model, world: World) -> Tour:
        """Return the tour with the goals of its stops as objects; raise QueryError for stops that cannot be used."""
        return replace(self, stops=tuple(stop.on(model, world) for stop in self.stops))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the stops."""
        return tuple(stop.name for stop in self.stops)

    @property
    def optional(self) -> tuple[int, ...]:
        """Indices of the optional stops."""
        return tuple(i for i, stop in enumerate(self.stops) if stop.optional)

    @property
    def remaining(self) -> tuple[int, ...]:
        """Indices of the stops that were neither visited nor skipped before."""
        return tuple(i for i in range(len(self.stops)) if i not in self.done)

    @property
    def words(self) -> str:
        """Remaining stops and their order in words, for the certificate of a front."""
        if not self.remaining:
            return "with no stop left to visit"
        stops = (self.stops[i] for i in self.remaining)
        *most, last = (f"{stop.name} (optional)" if stop.optional else stop.name for stop in stops)
        listed = f"{', '.join(most)} and {last}" if most else last
        if self.order == "any":
            return f"visiting {listed} in any order" if most else f"visiting {listed}"
        if self.order == "given":
            return f"visiting {listed} in this order" if most else f"visiting {listed}"
        left = self._pairs
        if self.done:  # pairs hold also over stops that are done
            left = [(i, j) for j in self.remaining for i in self.remaining if i in self.before[j]]
        pairs = ", ".join(f"{self.names[i]} before {self.names[j]}" for i, j in left)
        return f"visiting {listed} in any order{f' with {pairs}' if left else ''}"

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description, from which :meth:`of` builds an equal tour."""
        listed: dict[str, Any] = {"stops": [stop.describe() for stop in self.stops]}
        listed |= {"done": [*self.done]} if self.done else {}
        if isinstance(self.order, str):
            return listed if self.order == "given" else {"order": self.order, **listed}
        return {"some": [list(pair) for pair in self.order], **listed}

    # Order

    def _checked_order(self) -> Order:
        given = python_value(self.order)
        if isinstance(given, str):
            if given not in ("given", "any"):
                hint = did_you_mean(given, ["given", "any"])
                raise QueryError(f"order must be given, any, or a list of pairs of stops, got {shown(given)}.{hint}")
            return "any" if given == "any" else "given"
        if not isinstance(given, Sequence) or any(isinstance(pair, str) for pair in given):
            raise QueryError(f"order must be given, any, or a list of pairs of stops, got {shown(given)}")
        return tuple(self._checked_pair(pair) for pair in given)

    def _checked_pair(self, pair: Any) -> tuple[int, int]:
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise QueryError(
                "each pair of the order must be two stops, the one to visit first and the one to visit after it, got "
                f"{shown(pair)}"
            )
        first, second = (self._index(stop) for stop in pair)
        return first, second

    def _index(self, stop: Any, what: str = "pairs of the order") -> int:
        """Return the index of a stop that is given by its index or name; ``what`` names the argument in the error."""
        if isinstance(stop, str) and stop in self.names:
            return self.names.index(stop)
        if is_whole(stop) and 0 <= int(stop) < len(self.stops):
            return int(stop)
        raise QueryError(
            f"{what} must name stops: {', '.join(self.names)}; or give their index from 0 to {len(self.stops) - 1}, "
            f"got {shown(stop)}.{did_you_mean(stop, self.names)}"
        )

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        """Pairs (i, j) of indices of stops where stop i must come before stop j."""
        if isinstance(self.order, str):
            return [(i, i + 1) for i in range(len(self.stops) - 1)] if self.order == "given" else []
        return [(self._index(i), self._index(j)) for i, j in self.order]

    @cached_property
    def before(self) -> tuple[frozenset[int], ...]:
        """For each stop, the indices of all stops that must come before it; QueryError if the pairs make a cycle."""
        direct: list[set[int]] = [set() for _ in self.stops]
        for i, j in self._pairs:
            direct[j].add(i)
        before: dict[int, frozenset[int]] = {}
        while len(before) < len(self.stops):
            ready = [j for j, own in enumerate(direct) if j not in before and own <= before.keys()]
            if not ready:
                cycle = self._cycle(direct)
                raise QueryError(
                    f"pairs of the order must not contradict each other, but "
                    f"{' before '.join(self.names[i] for i in cycle)}; leave one of these pairs out"
                )
            before |= {j: frozenset(direct[j]).union(*(before[i] for i in direct[j])) for j in ready}
        return tuple(before[j] for j in range(len(self.stops)))

    @staticmethod
    def _cycle(direct: Sequence[set[int]]) -> list[int]:
        """Return the indices of the stops of a cycle, each before the next, with the first one again at the end.

        direct  for each stop, the stops that a pair puts before it; there must be a cycle among them
        """
        within = set(range(len(direct)))
        while len(left := {j for j in within if direct[j] & within}) < len(within):
            within = left
        path = [min(within)]
        while path[-1] not in path[:-1]:
            path.append(min(direct[path[-1]] & within))
        return path[path.index(path[-1]) :][::-1]

    @cached_property
    def layers(self) -> tuple[frozenset[int], ...]:
        """Sets of visited or skipped stops that the order allows, by size: the first is `done`, the last has all stops.

        Raises QueryError if there are too many.
        """
        row = [frozenset[int](map(self._index, self.done))]
        found = dict.fromkeys(row)
        while row:
            more = dict.fromkeys(
                done | {j} for done in row for j in range(len(self.stops)) if j not in done and self.before[j] <= done
            )
            found |= more
            row = list(more)
            if len(found) > max(MOST_SETS, len(self.stops) + 1):
                raise QueryError(
                    f"a tour must have at most {MOST_SETS:,} sets of visited stops, which are twelve stops in any "
                    f"order; these {counted(len(self.stops), 'stop')} have more. Keep some of them in order (order: "
                    "given, or more pairs in some), or plan two tours"
                )
        return tuple(found)

    @property
    def has_many_layers(self) -> bool:
        """True if the tour has too many layers (sets of decided stops) for a search over all states of each stop."""
        return len(self.layers) > max(MOST_LAYERS, len(self.stops) + 1)

    @cached_property
    def steps(self) -> tuple[tuple[TourStep, ...], ...]:
        """Visits that are possible in each layer.

        A visit skips all undecided stops that must come before it. It is possible only if these are optional.
        """
        number = {done: i for i, done in enumerate(self.layers)}
        return tuple(
            tuple(
                TourStep(j, number[done | before | {j}], tuple(sorted(before - done)))
                for j, before in enumerate(self.before)
                if j not in done and all(self.stops[i].optional for i in before - done)
            )
            for done in self.layers
        )

    @property
    def endings(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Yield the index of each layer in which the tour may end, and the indices of the stops then skipped."""
        for i, done in enumerate(self.layers):
            left = [j for j in range(len(self.stops)) if j not in done]
            if all(self.stops[j].optional for j in left):
                yield i, tuple(left)
