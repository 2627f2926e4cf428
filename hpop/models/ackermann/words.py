"""Shortest paths of a car-like base: Dubins' words, and those of Reeds and Shepp with motions backwards.

A word is a sequence of at most five arcs of the smallest radius and straight moves. Dubins (1957, doi 10.2307/2372560)
has six words for a base that only goes forwards. Reeds and Shepp (1990, doi 10.2140/pjm.1990.145.367) have 48 words in
nine families. Here lengths are in radii. Each word is composed again, and counts only if it ends in the wanted pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray

LETTERS = {"L": 1.0, "S": 0.0, "R": -1.0}
FLIPPED = str.maketrans("LR", "RL")
MOST = 5  # letters of a word
MISSED = 1e-7  # radii or rad: largest error of the end of a word
SHORT = 1e-9  # radii: shorter arcs and moves are left out
QUARTER = 0.5 * math.pi

Formula = Callable[[FloatArray, FloatArray, FloatArray], tuple[Column, Column, Column, BoolArray]]


class Word(NamedTuple):
    """Arcs and straight moves of N paths.

    curvature  (N, 5)  1 for a left arc, 0 for a straight move, -1 for a right arc
    length     (N, 5)  radii, negative backwards, 0 for letters that are left out
    """

    curvature: FloatArray
    length: FloatArray

    @property
    def total(self) -> FloatArray:
        """Length (N,) of each path, radii."""
        total: FloatArray = np.abs(self.length).sum(axis=1)
        return total


def _half_turns(angle: Column) -> Column:
    """Return angles (N,) in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _turns(angle: Column) -> Column:
    """Return angles (N,) in [0, 2 pi); an angle just below a whole turn is 0."""
    found = angle % (2.0 * np.pi)
    return np.where(found > 2.0 * np.pi - SHORT, 0.0, found)


def composed(curvature: FloatArray, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x and y (N, 6), radii, and yaw (N, 6), rad, before the first and after each letter of N words."""
    x, y, yaw = (np.zeros((len(length), length.shape[1] + 1)) for _ in range(3))
    for i in range(length.shape[1]):
        way, turn = length[:, i], curvature[:, i] * length[:, i]
        along = way * np.sinc(0.5 * turn / np.pi)
        yaw[:, i + 1] = yaw[:, i] + turn
        x[:, i + 1] = x[:, i] + along * np.cos(yaw[:, i] + 0.5 * turn)
        y[:, i + 1] = y[:, i] + along * np.sin(yaw[:, i] + 0.5 * turn)
    return x, y, yaw


def dubins(x: FloatArray, y: FloatArray, yaw: FloatArray) -> Word:
    """Return the shortest paths forwards from (0, 0, 0) to poses x, y (N,), radii, and yaw (N,), rad."""
    return _shortest(_dubins_words(x, y, yaw), (x, y, yaw))


def reeds_shepp(x: FloatArray, y: FloatArray, yaw: FloatArray) -> Word:
    """Return the shortest paths forwards and backwards from (0, 0, 0) to poses x, y (N,), radii, and yaw (N,), rad."""
    return _shortest(_reeds_shepp_words(x, y, _half_turns(yaw)), (x, y, yaw))


def _shortest(words: Iterator[tuple[str, FloatArray]], ends: tuple[FloatArray, FloatArray, FloatArray]) -> Word:
    x, y, yaw = ends
    scale = MISSED * (1.0 + np.hypot(x, y))
    best, curvature, length = (np.full(x.size, np.inf), *(np.zeros((x.size, MOST)) for _ in range(2)))
    for letters, lengths in words:  # (N, c)
        own = np.array([LETTERS[letter] for letter in letters])
        bends = np.broadcast_to(own, lengths.shape)
        total = np.abs(lengths).sum(axis=1)
        better = np.flatnonzero(total < best)  # False for nan
        end_x, end_y, end_yaw = (column[:, -1] for column in composed(bends[better], lengths[better]))
        off = np.maximum(np.hypot(end_x - x[better], end_y - y[better]), np.abs(_half_turns(end_yaw - yaw[better])))
        rows = better[off <= scale[better]]
        best[rows], curvature[rows], length[rows] = total[rows], 0.0, 0.0
        curvature[rows, : own.size], length[rows, : own.size] = own, lengths[rows]
    return Word(curvature, np.where(np.abs(length) > SHORT, length, 0.0))


def _dubins_words(x: FloatArray, y: FloatArray, yaw: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield the six words of Dubins with their lengths (N, 3), nan where there is none."""
    for letters in ("LSL", "RSR", "LSR", "RSL", "LRL", "RLR"):
        sides = [LETTERS[letters[0]], LETTERS[letters[2]]]  # circles to the left (1) or right (-1) of start and end
        dx, dy = x - sides[1] * np.sin(yaw), y + sides[1] * np.cos(yaw) - sides[0]
        apart, along = np.hypot(dx, dy), np.arctan2(dy, dx)
        with np.errstate(invalid="ignore"):
            if letters[1] == "S":
                crossed = sides[0] - sides[1]
                middle = np.sqrt(apart**2 - crossed**2)
                ahead = along + np.arctan2(crossed, middle)
                first, last = sides[0] * ahead, sides[1] * (yaw - ahead)
            else:
                middle = 2.0 * np.pi - 2.0 * np.arcsin(0.25 * apart)
                first = sides[0] * along + 0.5 * middle
                last = sides[0] * yaw - first + middle
        yield letters, np.stack([_turns(first), middle, _turns(last)], axis=1)


# Words of Reeds and Shepp: each formula gives the lengths t, u, v of one word of its family, nan where there is none.
# Others follow by driving in the opposite direction, by mirroring left and right, and by reversing the order.


def _csc_same(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x - np.sin(yaw), y - 1.0 + np.cos(yaw)
    t = np.arctan2(dy, dx)
    return t, np.hypot(dx, dy), _half_turns(yaw - t)


def _csc_crossed(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x + np.sin(yaw), y - 1.0 - np.cos(yaw)
    u = np.sqrt(dx**2 + dy**2 - 4.0)
    t = _half_turns(np.arctan2(dy, dx) + np.arctan2(2.0, u))
    return t, u, _half_turns(t - yaw)


def _ccc(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x - np.sin(yaw), y - 1.0 + np.cos(yaw)
    u = -2.0 * np.arcsin(0.25 * np.hypot(dx, dy))
    t = _half_turns(np.arctan2(dy, dx) + 0.5 * u + np.pi)
    return t, u, _half_turns(yaw - t + u)


def _first_and_last(
    u: FloatArray, v: FloatArray, dx: FloatArray, dy: FloatArray, yaw: FloatArray
) -> tuple[Column, Column]:
    """Return the first and last length of words of four arcs, whose second and third lengths are u and v."""
    delta = _half_turns(u - v)
    a, b = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1.0
    first = np.arctan2(dy * a - dx * b, dx * a + dy * b)
    turned = 2.0 * (np.cos(delta) - np.cos(v) - np.cos(u)) + 3.0 < 0
    first = _half_turns(np.where(turned, first + np.pi, first))
    return first, _half_turns(first - u + v - yaw)


def _cccc_opposite(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x + np.sin(yaw), y - 1.0 - np.cos(yaw)
    u = np.arccos(0.25 * (2.0 + np.hypot(dx, dy)))
    t, v = _first_and_last(u, -u, dx, dy, yaw)
    return t, u, -u, v


def _cccc_equal(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x + np.sin(yaw), y - 1.0 - np.cos(yaw)
    u = -np.arccos((20.0 - dx**2 - dy**2) / 16.0)
    t, v = _first_and_last(u, u, dx, dy, yaw)
    return t, u, u, v


def _ccsc_same(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x - np.sin(yaw), y - 1.0 + np.cos(yaw)
    r = np.sqrt(dx**2 + dy**2 - 4.0)
    t = _half_turns(np.arctan2(dy, dx) + np.arctan2(r, -2.0))
    return t, np.full(x.shape, -QUARTER), 2.0 - r, _half_turns(yaw - QUARTER - t)


def _ccsc_crossed(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x + np.sin(yaw), y - 1.0 - np.cos(yaw)
    t = np.arctan2(dx, -dy)
    return t, np.full(x.shape, -QUARTER), 2.0 - np.hypot(dx, dy), _half_turns(t + QUARTER - yaw)


def _ccscc(x: FloatArray, y: FloatArray, yaw: FloatArray) -> tuple[Column, ...]:
    dx, dy = x + np.sin(yaw), y - 1.0 - np.cos(yaw)
    u = 4.0 - np.sqrt(dx**2 + dy**2 - 4.0)
    t = _half_turns(np.arctan2((4.0 - u) * dx - 2.0 * dy, -2.0 * dx + (u - 4.0) * dy))
    quarter = np.full(x.shape, -QUARTER)
    return t, quarter, u, quarter, _half_turns(t - yaw)


FAMILIES: tuple[tuple[str, Callable[[FloatArray, FloatArray, FloatArray], tuple[Column, ...]], bool], ...] = (
    ("LSL", _csc_same, False),
    ("LSR", _csc_crossed, False),
    ("LRL", _ccc, True),
    ("LRLR", _cccc_opposite, False),
    ("LRLR", _cccc_equal, False),
    ("LRSL", _ccsc_same, True),
    ("LRSR", _ccsc_crossed, True),
    ("LRSLR", _ccscc, False),
)
"""Letters and formula of each family, and whether its words can also be driven in reversed order."""


def _reeds_shepp_words(x: FloatArray, y: FloatArray, yaw: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield all words of Reeds and Shepp with their lengths (N, c), nan where there is none."""
    back_x, back_y = x * np.cos(yaw) + y * np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw)
    for letters, formula, reverses in FAMILIES:
        for is_reversed in (False, True)[: 1 + reverses]:
            px, py = (back_x, back_y) if is_reversed else (x, y)
            order = slice(None, None, -1 if is_reversed else 1)
            for sense in (1.0, -1.0):
                for side in (1.0, -1.0):
                    with np.errstate(invalid="ignore"):
                        lengths = np.stack(formula(sense * px, side * py, sense * side * yaw), axis=1)
                    word = letters if side > 0 else letters.translate(FLIPPED)
                    yield word[order], sense * lengths[:, order]
