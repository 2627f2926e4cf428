"""Features of a GeoJSON file that are read, by their properties, and notes on what that leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from hpop.base.text import shown, some
from hpop.errors import MapError, did_you_mean
from hpop.world.readers.features import Feature
from hpop.world.readers.tags import Choice, values

LEVELS = ("level", "floor")
"""Properties that say on which floor a feature is."""
TOLD = 8
"""Values of a property that a message lists, at most."""


def chosen_features(
    features: Sequence[Feature],
    choice: Choice,
    path: str | Path,
    *,
    by_level: Callable[[Feature], bool] | None = None,
) -> tuple[list[Feature], tuple[str, ...]]:
    """Return the features that are asked for, and a note; raise MapError where there are none.

    by_level  whether a feature, such as a door, is chosen by its level alone
    """
    if not choice:
        return list(features), ()
    found = [
        feature
        for feature in features
        if choice.takes(feature.properties, LEVELS if by_level is not None and by_level(feature) else None)
    ]
    if found:
        return found, (f"{path}: {len(found):,} of {len(features):,} features are read, those with {choice}.",)
    for key in choice.given:
        there: dict[str, None] = {}
        for feature in features:
            if key in feature.properties:
                there.update(dict.fromkeys(sorted(values(key, feature.properties[key]))))
        if not there:
            known = dict.fromkeys(str(name) for feature in features for name in feature.properties)
            raise MapError(
                f"{path}: where: no feature has a property {shown(key)}.{did_you_mean(key, known)} Properties there: "
                f"{shown(some(list(known), TOLD), 300) if known else 'none'}."
            )
        if not any(Choice({key: choice.given[key]}).takes(feature.properties) for feature in features):
            raise MapError(
                f"{path}: where: no feature has {key}: {shown(choice.given[key])}. Its values there: "
                f"{shown(some(list(there), TOLD), 300)}."
            )
    raise MapError(f"{path}: where: no feature has all of {choice}.")


def notes_of_levels(of: Sequence[Feature], choice: Choice, path: str | Path) -> Iterator[str]:
    """Yield a note where features of several floors are read as one."""
    for key in LEVELS:
        if key in choice.given:
            continue
        there = sorted({v for feature in of if key in feature.properties for v in values(key, feature.properties[key])})
        if len(there) > 1:
            yield (
                f"{path}: its features have several values of {key} ({shown(some(there, TOLD), 200)}), all read as one "
                f"floor. where: {{{key}: {there[0]}}} chooses."
            )
