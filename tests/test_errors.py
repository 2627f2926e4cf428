"""Errors tell programs that call hpop apart by their exit codes."""

from __future__ import annotations

import hpop.errors
from hpop.cli.commands import NO_PATH, NOTHING_FOUND
from hpop.cli.terminal import INTERRUPTED


def test_each_kind_of_error_has_an_exit_code_of_its_own() -> None:
    kinds = [kind for kind in vars(hpop.errors).values() if isinstance(kind, type) and "exit_code" in vars(kind)]
    codes = [kind.exit_code for kind in kinds]
    assert len(codes) > 10
    assert len(set(codes)) == len(codes)
    assert not {0, 2, NO_PATH, INTERRUPTED} & set(codes)
    assert hpop.errors.LimitError.exit_code == NOTHING_FOUND
