"""Random numbers as a caller gives them: ``rng`` as SPEC 7 of Scientific Python has it, and the seed it comes to.

What is drawn follows from a seed that is written down, in certificates, provenance and saved fronts, so that a result
can be had again whatever the ``rng`` was. Scenario files have that ``seed`` itself.
"""

from __future__ import annotations

from types import EllipsisType
from typing import Any, TypeAlias

import numpy as np

from hpop.base.options import MOST_SEED, set_wholes, whole
from hpop.base.text import shown
from hpop.errors import OptionError

Source: TypeAlias = np.random.Generator | np.random.BitGenerator | np.random.SeedSequence
RNG: TypeAlias = int | Source | None
"""A seed; a source of random numbers, of which one is drawn; None for fresh ones."""
MaybeRNG: TypeAlias = RNG | EllipsisType


def seed_of(rng: RNG) -> int:
    """The seed of random numbers: a whole number is one itself, of a Generator or the like one is drawn, None is fresh.

    A Generator goes on by that one number: two draws from the same differ. Raises OptionError for anything else.

    >>> seed_of(7), seed_of(None) == seed_of(None)
    (7, False)
    >>> seed_of(np.random.default_rng(7)) == seed_of(np.random.default_rng(7))
    True
    """
    if rng is None or isinstance(rng, Source):
        return int(np.random.default_rng(rng).integers(MOST_SEED))
    hint = "or a numpy.random.Generator, or None for fresh random numbers"
    return whole("rng", rng, 0, MOST_SEED, "a seed", hint=hint)


def set_seed(owner: Any, rng: MaybeRNG) -> None:
    """Check the ``seed`` of a frozen dataclass; where ``rng`` was given (it is ... where not), set the seed by it."""
    if not isinstance(rng, EllipsisType):
        if owner.seed != type(owner).seed:
            raise OptionError(f"give rng, or a seed, not both; got {shown(rng)} and {shown(owner.seed)}")
        object.__setattr__(owner, "seed", seed_of(rng))
    set_wholes(owner, "seed", least=0, most=MOST_SEED)
