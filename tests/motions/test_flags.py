"""Integrals of the share of flags that are set: against the durations for which each flag is set."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.motions.flags import ASKED, AT_ONCE, FLAG_STEP, flag_integrals

RNG = np.random.default_rng(3)
MOTIONS, COUNT = 40, 25
LASTS = RNG.uniform(0.5, 3.0, MOTIONS)
BEGIN = RNG.uniform(0.0, 0.6, (MOTIONS, COUNT))
END = BEGIN + RNG.uniform(0.15, 0.6, (MOTIONS, COUNT))


def time_at(share, owner):
    """Return the time after a share of a motion that begins slowly."""
    return LASTS[owner] * np.sqrt(share)


def flags_at(share, owner, flags):
    here = (share[:, None] >= BEGIN[owner]) & (share[:, None] < END[owner])
    flags[:] = np.where(flags == ASKED, here, flags)


def set_for():
    """Return the time (M,), s, for which flags are set, in the mean of all flags of a motion."""
    whole = np.arange(MOTIONS)[:, None]
    begin, end = (time_at(np.minimum(share, 1.0), whole) for share in (BEGIN, END))
    return (end - begin).mean(axis=1)


def test_flags_that_change_are_timed_to_a_hundredth_of_the_motion():
    """25 flags change 25 to 50 times at independent moments; their errors partly cancel."""
    found = flag_integrals(flags_at, time_at, np.arange(MOTIONS), np.full(MOTIONS, 10 * FLAG_STEP), COUNT)
    error = np.abs(found - set_for())
    assert (error / LASTS).max() <= 0.01
    assert error.mean() <= 0.01 * set_for().mean()


def test_a_single_flag_is_timed_to_a_hundredth_of_the_motion():
    for which in range(COUNT):

        def one(share, owner, flags, which=which):
            every = np.full((share.size, COUNT), ASKED, np.int8)
            flags_at(share, owner, every)
            flags[:] = np.where(flags == ASKED, every[:, which : which + 1], flags)

        found = flag_integrals(one, time_at, np.arange(MOTIONS), np.full(MOTIONS, 10 * FLAG_STEP), 1)
        whole = np.arange(MOTIONS)
        begin, end = (time_at(np.minimum(share[:, which], 1.0), whole) for share in (BEGIN, END))
        assert (np.abs(found - (end - begin)) / LASTS).max() <= 0.01


def test_only_flags_that_differ_at_the_ends_of_an_interval_are_computed_anew():
    asked = []

    def counted(share, owner, flags):
        asked.append((flags == ASKED).sum(axis=1))
        flags_at(share, owner, flags)

    flag_integrals(counted, time_at, np.arange(MOTIONS), np.full(MOTIONS, 20 * FLAG_STEP), COUNT)
    assert (asked[0] == COUNT).all()
    assert asked[0].size == MOTIONS * 21
    for later in asked[1:]:
        assert later.min() > 0
        assert later.mean() < COUNT / 4


def test_motions_that_are_not_asked_for_are_nothing_and_blocks_change_nothing(monkeypatch):
    turned = RNG.uniform(0.0, 5.0, MOTIONS)
    some = np.arange(0, MOTIONS, 3)
    found = flag_integrals(flags_at, time_at, some, turned, COUNT)
    monkeypatch.setattr("hpop.motions.flags.AT_ONCE", 300)
    again = flag_integrals(flags_at, time_at, some, turned, COUNT)
    np.testing.assert_array_equal(found, again)
    assert (np.delete(found, some) == 0.0).all()
    assert found[some] == pytest.approx(set_for()[some], rel=0.2)


def test_few_flags_do_not_let_very_many_places_be_kept_together():
    """A place takes memory itself: the poses of all bodies of an arm."""
    sizes = []

    def counted(share, owner, flags):
        sizes.append(share.size)
        flags[:] = 0

    motions = np.arange(20_000)
    flag_integrals(counted, lambda share, _: share, motions, np.full(motions.size, 20 * FLAG_STEP), 1)
    assert sum(sizes) == 21 * motions.size
    assert max(sizes) <= AT_ONCE / 32
