"""A criterion that keeps what it is asked for: whether graphs are costed, and when that ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.registry import criteria
from hpop.criteria.base import criterion
from hpop.motions import Motions


@contextmanager
def watched() -> Iterator[list[tuple[float, int]]]:
    """Register "watched", a weighted length; weight and number of motions each time that it is asked for costs.

    ``interrupted`` is the time at which Ctrl-C comes.
    """
    costed: list[tuple[float, int]] = []

    @criterion("watched", group="C", unit="m", aggregate="sum")
    @dataclass(frozen=True)
    class Watched:
        weight: float = 1.0
        interrupted: int = 0

        def cost(self, m: Motions) -> Column:
            costed.append((self.weight, len(m)))
            if len(costed) == self.interrupted:
                raise KeyboardInterrupt
            return self.weight * m.base.length

    yield costed
    del criteria._types["watched"]
