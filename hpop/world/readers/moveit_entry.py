"""Value in a planning scene, with its location in words for messages, and checks of its type."""

from __future__ import annotations

from typing import Any, NamedTuple

from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.geometry.solids import MOST_SOLIDS

CUT = "..."
"""Text that ``ros2 topic echo`` writes in place of omitted values."""
NO_ARRAY = ("<sequence type:", "<array type:")


class SceneEntry(NamedTuple):
    """Value in a scene file (``given``), with its location in words (``what``) for messages."""

    what: str
    given: Any

    def fault(self, expected: str) -> MapError:
        """Return an error that states the location, the expected value and the actual value."""
        return MapError(f"{self.what} must be {expected}; got {shown(self.given)}.")

    def get(self, key: str) -> SceneEntry:
        """Return the entry under a key of a mapping; the value of the entry is None if the key is missing."""
        if not isinstance(self.given, dict):
            raise self.fault("a yaml mapping")
        return SceneEntry(f"{self.what}: {key}", self.given.get(key))

    def entries(self, most: int = MOST_SOLIDS) -> list[SceneEntry]:
        """Return the entries of a list; an empty list for a missing one."""
        given = [] if self.given is None else self.given
        if isinstance(given, str) and given.startswith(NO_ARRAY):
            raise MapError(f"{self.what} is left out, as ros2 topic echo --no-arr does; print it without that option.")
        if given == CUT or (isinstance(given, list) and CUT in given):
            raise MapError(
                f"{self.what} is cut short (...), as ros2 topic echo does; print all: ros2 topic echo --full-length."
            )
        if not isinstance(given, list):
            raise self.fault("a list")
        if len(given) > most:
            raise MapError(f"{self.what} has {len(given):,} entries; at most {most:,} are read. Leave some out.")
        return [SceneEntry(f"{self.what} {place}", entry) for place, entry in enumerate(given)]

    def numbers(self, keys: str) -> tuple[float, ...]:
        """Return a number for each letter of ``keys``, such as "xyz", from a list or a mapping with these keys."""
        given = self.given
        if isinstance(given, dict) and given.keys() == set(keys):
            given = [given[key] for key in keys]
        if not isinstance(given, list) or len(given) != len(keys):
            raise self.fault(f"[{', '.join(keys)}]")
        return tuple(float(real(self.what, value, -MOST, MOST, error=MapError)) for value in given)

    def name(self, what: str) -> str:
        """Return a name, a text that is not empty; ``what`` says in a message what it names."""
        if not isinstance(self.given, str) or not self.given:
            raise self.fault(f"the name of {what}")
        return self.given
