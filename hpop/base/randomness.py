"""Random seeds from the argument ``rng`` (SPEC 7 of Scientific Python).

All random draws of a run follow from one seed. Certificates, provenance and saved fronts record it, so results can be
reproduced whatever ``rng`` was. Scenario files give the ``seed`` itself.
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
"""A seed; a source of random numbers, from which a seed is drawn; or None for a fresh seed."""
MaybeRNG: TypeAlias = RNG | EllipsisType


def seed_of(rng: RNG) -> int:
    """Return a seed: ``rng`` if it is a whole number, a draw from it if it is a Generator, a fresh seed for None.

    Drawing advances a Generator, so two calls with one Generator return different seeds. Raises OptionError for other
    values.

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
    """Set the ``seed`` of a frozen dataclass from an argument ``rng``, unless that is ``...``, and check the seed."""
    if not isinstance(rng, EllipsisType):
        if owner.seed != type(owner).seed:
            raise OptionError(f"give either rng or seed, got rng={shown(rng)} and seed={shown(owner.seed)}")
        object.__setattr__(owner, "seed", seed_of(rng))
    set_wholes(owner, "seed", least=0, most=MOST_SEED)
