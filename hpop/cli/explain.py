"""``hpop explain``: what a printed word means, and what a criterion, planner, ... of that name is."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from hpop.base import registry
from hpop.base.registry import Registry
from hpop.base.text import shown
from hpop.cli.glossary import entries
from hpop.cli.registered import declared
from hpop.errors import UnknownName, did_you_mean

REGISTRIES: tuple[Registry[Any], ...] = (
    registry.criteria,
    registry.planners,
    registry.models,
    registry.goals,
    registry.readers,
    registry.formats,
)


def explained(word: str) -> str:
    """All that is known of a word; UnknownName where that is nothing."""
    meant = _plain(word)
    found = [*_meanings(meant), *_registered(meant)]
    if not found:
        words = [name for entry in entries() for name in (entry.word, *entry.also)]
        names = [name for each in REGISTRIES for name in each]
        near = did_you_mean(meant, [*words, *names])
        raise UnknownName(f"unknown word {shown(word)}.{near} {known()}")
    return "\n\n".join(found)


def known() -> str:
    """The words that are explained."""
    words = ", ".join(entry.word for entry in entries())
    *kinds, last = (each.kind for each in REGISTRIES)
    return f"Explained are {words}; and the name of each {', '.join(kinds)} and {last}."


def _plain(word: str) -> str:
    """A word as it is looked up: one that is printed with capitals, dashes or blanks is the same."""
    return re.sub(r"[\s_-]+", " ", word.strip().lower())


def _meanings(word: str) -> Iterator[str]:
    for entry in entries():
        if word in map(_plain, (entry.word, *entry.also)):
            yield f"{entry.word}: {entry.meaning}"


def _registered(word: str) -> Iterator[str]:
    for each in REGISTRIES:
        for name in each:
            if _plain(name) == word:
                item = each[name]
                text = re.sub(r":\w+:`~?([^`]+)`|``([^`]+)``", r"\1\2", inspect.cleandoc(item.__doc__ or ""))
                yield "\n".join(filter(None, [f"{name}, a {each.kind}: {declared(item)}".rstrip(": "), "", text]))
