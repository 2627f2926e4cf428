"""Claims: a set answers as its vectors one by one do, whatever their number, and keeps the non-dominated ones only."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.search.general.tables import PIECE, ROOM, SET_COLUMNS, SIZE, START, add_to_set, is_covered, numbers_needed


def members(sets, pool, s, k):
    start, size, room = sets[s, START], sets[s, SIZE], sets[s, ROOM]
    return {tuple(int(pool[start + j * room + i]) for j in range(k - 1)) for i in range(size)}


def on_a_sphere(rng, count, k, scale):
    """Vectors of which nearly none dominates another in what follows their first cost, so that sets grow large."""
    x = np.abs(rng.normal(size=(count, k - 1)))
    near = scale * (1 - x / np.linalg.norm(x, axis=1)[:, None])
    return np.column_stack([np.zeros(count), near]).astype(np.int64)


@pytest.mark.cases(
    but=[f"600-{k}-{number}" for k in (2, 4, 5) for number in ("int32", "int64")]
    + ["600-1-int32", "600-3-int64", "600-6-int32"]
)
@pytest.mark.parametrize("number", [np.int32, np.int64])
@pytest.mark.parametrize("k", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("large", [0, 600, pytest.param(1000, marks=pytest.mark.proof)])
def test_sets_answer_as_vectors_one_by_one(k, number, large):
    rng = np.random.default_rng(k)
    scale = np.iinfo(number).max // 4
    if large and k >= 3:
        vectors = on_a_sphere(rng, large, k, scale)
    else:
        vectors = rng.integers(0, 6, (300, k)) * (scale // 6 if large else 1)
    sets, pool = np.zeros((3, SET_COLUMNS), np.int64), np.zeros(40_000, number)
    expected: list[set[tuple[int, ...]]] = [set(), set(), set()]
    used = largest = 0
    for vector in vectors:
        s = int(rng.integers(3))
        rest = tuple(vector[1:].tolist())
        covered = any(all(a <= b for a, b in zip(m, rest, strict=True)) for m in expected[s])
        f = vector.astype(number)
        assert is_covered(sets, pool, s, f) == covered
        if covered:
            continue
        before, room = used, numbers_needed(sets, s, k)
        used = add_to_set(sets, pool, s, f, used)
        assert used - before <= room
        expected[s] = {m for m in expected[s] if not all(b <= a for a, b in zip(m, rest, strict=True))} | {rest}
        if len(expected[s]) < PIECE or len(expected[s]) % 8 == 0:  # of large sets, each member some of the times
            assert members(sets, pool, s, k) == expected[s]
        assert sets[s, SIZE] == len(expected[s])
        largest = max(largest, len(expected[s]))
    assert [members(sets, pool, s, k) for s in range(3)] == expected
    assert not (large and k >= 4) or largest > 2 * PIECE


def test_a_full_set_moves_and_leaves_the_others_alone():
    sets, pool = np.zeros((2, SET_COLUMNS), np.int64), np.zeros(4096, np.int32)
    used = add_to_set(sets, pool, 1, np.array([0, 50, 50], np.int32), 0)
    for i in range(200):
        used = add_to_set(sets, pool, 0, np.array([0, i, 200 - i], np.int32), used)
    assert members(sets, pool, 1, 3) == {(50, 50)}
    assert members(sets, pool, 0, 3) == {(i, 200 - i) for i in range(200)}
    used = add_to_set(sets, pool, 0, np.array([0, 0, 0], np.int32), used)
    assert members(sets, pool, 0, 3) == {(0, 0)}
