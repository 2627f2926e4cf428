"""Rules of a planning scene for a robot's links: padding, scale, and pairs of bodies that may touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hpop.base.options import LEAST, MOST, real
from hpop.base.text import shown
from hpop.errors import MapError

Pair = tuple[str, str]
"""Names of two bodies, in alphabetical order."""
WIDEST = 10.0
"""Largest padding of a link, m."""


@dataclass(frozen=True)
class LinkRules:
    """Rules for the links of an arm, by their names.

    padding  m, by link: distance that a link keeps from obstacles, in addition to the usual distance
    scale    by link: factor by which a link is enlarged before it is tested with obstacles
    pairs    by two names, of links or of obstacles, in alphabetical order: whether the two may touch
    others   by name of a link or an obstacle: whether it may touch any body that ``pairs`` does not name with it
    """

    padding: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    pairs: Mapping[Pair, bool] = field(default_factory=dict)
    others: Mapping[str, bool] = field(default_factory=dict)

    def may_touch(self, one: str, other: str) -> bool:
        """Return whether two bodies may touch.

        An entry for the pair decides. Without one, the entries of both names decide, and forbid if one of them does.

        >>> rules = LinkRules(pairs={("can", "hand"): False}, others={"hand": True, "wall": False})
        >>> rules.may_touch("hand", "can"), rules.may_touch("hand", "cup"), rules.may_touch("hand", "wall")
        (False, True, False)
        """
        pair = (one, other) if one < other else (other, one)
        if pair in self.pairs:
            return self.pairs[pair]
        given = [self.others[name] for name in pair if name in self.others]
        return bool(given) and all(given)

    def __bool__(self) -> bool:
        return bool(self.padding or self.scale or self.pairs or self.others)

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description; :meth:`build` turns it into equal rules."""
        return {
            "padding": dict(self.padding),
            "scale": dict(self.scale),
            "pairs": [[*pair, allowed] for pair, allowed in self.pairs.items()],
            "others": dict(self.others),
        }

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> LinkRules:
        """Build rules from their description; MapError, TypeError or LookupError if it is malformed."""
        pairs = {(str(a), str(b)) if a < b else (str(b), str(a)): _flag(allowed) for a, b, allowed in data["pairs"]}
        return cls(
            {str(link): padding_of(f"the padding of {shown(link)}", by) for link, by in data["padding"].items()},
            {str(link): scale_of(f"the scale of {shown(link)}", by) for link, by in data["scale"].items()},
            pairs,
            {str(name): _flag(allowed) for name, allowed in data["others"].items()},
        )


def padding_of(what: str, given: Any) -> float:
    """Check a padding of a link, m, and return it; MapError, which calls it ``what``, if it is none."""
    return float(real(what, given, 0.0, WIDEST, "a length in m", error=MapError))


def scale_of(what: str, given: Any) -> float:
    """Check a scale of a link and return it; MapError, which calls it ``what``, if it is none."""
    return float(real(what, given, LEAST, MOST, "a factor", error=MapError))


def _flag(given: Any) -> bool:
    if not isinstance(given, bool):
        raise MapError(f"whether two bodies may touch must be true or false; got {shown(given)}.")
    return given
