"""Hostile inputs: mutations of bytes, and of the trees that JSON and YAML hold."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

Rng = np.random.Generator

NUMBERS: list[Any] = [
    *(0, -0.0, 1, -1, 2, 0.1, 0.5, 1e-6, 1e-9, 1e-320, 5e-324, 1e6, 1e15, 1e30, -1e30, 1e308, -1e308),
    *(float("nan"), float("inf"), -float("inf"), 2**31, -(2**31), 2**53, 2**62, 2**63, 2**64, 10**390, -(10**400)),
]
WORDS: list[Any] = [
    *("", " ", "any", "no", "yes", "nan", "inf", "1e-3", "90 deg", "1e30 deg", "lattice", "turns", "NoSuchName"),
    *("\x1b[31mred\x1b[0m", "\x07bell", "a\x00b", "\u202egnp.exe", "\x9b2J", "$\\frac{1}{$", "ü" * 300, "n" * 5000),
    *("../../../etc/passwd", "/dev/zero", "/", ".", "%s%n", "{0.__class__}", "\ud800", "-", "--help", "~"),
]
OTHERS: list[Any] = [None, True, False, [], {}, [[]], {"": None}, [None] * 3, [0, 0], [1, 2, 3, 4], {"a": {"b": [1]}}]


def hostile(rng: Rng) -> Any:
    """Return a hostile value: numbers at the edges, words with control characters, unexpected containers."""
    pool = (NUMBERS, NUMBERS, WORDS, OTHERS)[rng.integers(4)]
    value = copy.deepcopy(pool[rng.integers(len(pool))])
    if rng.random() < 0.03:
        for _ in range(int(rng.integers(50, 400))):
            value = [value]
    return value


def bent_bytes(data: bytes, rng: Rng) -> bytes:
    """Bytes with one to four of: flipped, overwritten, inserted, cut out, doubled, cut short."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(out) + 1))
        length = int(rng.integers(1, 1 + min(64, max(1, len(out)))))
        kind = int(rng.integers(6))
        if kind == 0 and at < len(out):
            out[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            out[at : at + length] = rng.bytes(length)
        elif kind == 2:
            out[at:at] = rng.bytes(length)
        elif kind == 3:
            del out[at : at + length]
        elif kind == 4:
            out[at:at] = out[at : at + length]
        elif rng.random() < 0.3:
            del out[at:]
    return bytes(out)


def bent_tree(tree: Any, rng: Rng, *, most: int = 3) -> Any:
    """Return a copy of a tree of lists and dicts with one of its nodes changed, or up to ``most``."""
    holder = [copy.deepcopy(tree)]
    for _ in range(int(rng.integers(1, most + 1))):
        places = [*_places(holder)]
        _CHANGES[rng.integers(len(_CHANGES))](*places[rng.integers(len(places))], places, rng)
    return holder[0]


def _places(node: Any) -> Any:
    """Every (container, key) of a tree."""
    stack = [node]
    while stack:
        container = stack.pop()
        for key in list(container) if isinstance(container, dict) else range(len(container)):
            yield container, key
            if isinstance(container[key], dict | list):
                stack.append(container[key])


def _replaced(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    container[key] = hostile(rng)


def _nudged(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    value = container[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        container[key] = hostile(rng)
    else:
        near = min(max(value, -1e300), 1e300)  # an integer of 400 digits is no float
        nudges = [-value, near + float(rng.normal()), near * 10.0 ** float(rng.integers(-8, 9)), str(near)]
        container[key] = nudges[rng.integers(len(nudges))]


def _removed(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    if len(container) > 1:
        del container[key]


def _copied(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    """Replace a value by one from another place, shared: an alias in YAML."""
    other, where = places[rng.integers(len(places))]
    value = other[where]
    holds_place = isinstance(value, dict | list) and any(inner is container for inner, _ in [*_places([value])])
    if value is not container and not holds_place:
        container[key] = value


def _renamed(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    if isinstance(container, dict):
        container[str(hostile(rng))[:400]] = container.pop(key)
    else:
        container.insert(key, copy.deepcopy(container[key]))


def _repeated(container: Any, key: Any, places: list[Any], rng: Rng) -> None:
    if isinstance(container[key], list) and len(container[key]) < 1000:
        container[key] = container[key] * int(rng.integers(2, 20))


_CHANGES = [_replaced, _replaced, _nudged, _nudged, _removed, _copied, _renamed, _repeated]
