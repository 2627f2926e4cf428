"""Claims: the heap sorts keys of several words, packing keeps the order, kernels compile anywhere, or lean."""

from __future__ import annotations

import re
import subprocess
import sys

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.kernels import drop_first, plan_keys, push, repack


@pytest.mark.parametrize("words", [1, 2, 3])
def test_the_heap_sorts(words):
    rng = np.random.default_rng(words)
    entries = rng.integers(0, 4, (300, words))
    keys, values = np.zeros(300 * words, np.int64), np.zeros(300, np.int64)
    for i, entry in enumerate(entries):
        push(keys, values, i, words, entry, i)
    order = []
    for size in range(300, 0, -1):
        order.append(int(values[0]))
        assert keys[:words].tolist() == entries[values[0]].tolist()
        drop_first(keys, values, size, words)
    assert sorted(order) == list(range(300))
    assert [entries[i].tolist() for i in order] == sorted(entries.tolist())


def pack(vector: list[int], plan) -> list[int]:
    word, shift, _, words = plan
    key = [0] * words
    for value, w, s in zip(vector, word.tolist(), shift.tolist(), strict=True):
        key[w] |= value << s
    return key


@given(st.lists(st.integers(0, 2**61), min_size=1, max_size=6), st.randoms(use_true_random=False))
def test_packing_keeps_the_lexicographic_order(largest, random):
    plan = plan_keys(largest)
    vectors = [[random.randint(0, most) for most in largest] for _ in range(8)] + [largest]
    assert all(0 <= word < 2**62 for v in vectors for word in pack(v, plan))
    assert sorted(vectors) == sorted(vectors, key=lambda v: pack(v, plan))
    wider = plan_keys([2 * most for most in largest])
    keys = np.array([pack(v, plan) for v in vectors], np.int64).ravel()
    out = np.zeros(len(vectors) * wider[3], np.int64)
    repack(keys, len(vectors), plan, wider, out)
    assert out.reshape(len(vectors), -1).tolist() == [pack(v, wider) for v in vectors]


def test_importing_the_package_does_not_import_numba():
    code = "import sys, hpop.search; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_lean_kernels_count_no_references():
    """Others count them at each call of a helper that is not inlined, with two atomic instructions an array."""

    def halve(values, i):
        while values[i] > 3:
            values[i] //= 2

    def halve_all(values):
        for i in range(len(values)):
            helper(values, i)

    counted = []
    for decorate in (kernel, lean):
        helper = decorate(halve)
        compiled = decorate(halve_all)
        values = np.arange(100)
        compiled(values)
        assert values.max() == 3
        counted.append(sum(len(re.findall(r"\block\b", text)) for text in compiled.inspect_asm().values()))
    assert counted[0] > counted[1] == 0


def test_a_lean_kernel_that_allocates_does_not_compile():
    @lean
    def allocates(n):
        return np.zeros(n).sum()

    with pytest.raises(numba.core.errors.NumbaError):
        allocates(3)
