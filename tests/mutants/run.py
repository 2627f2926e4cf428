"""One run of some tests to the first failure: `python run.py TESTS LAST`.

TESTS is JSON with the seconds of each test, in the order in which they run; LAST holds the last one that began.

A test that takes far more processor time than it did is stopped, and the process with it: a signal that nothing
handles, for a loop without end may be in compiled code. A failing example of hypothesis is not made smaller.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ALLOWED = 20.0  # processor seconds, for compiling what was changed, and ten times what the test took by the clock


class Selection:
    """Tests to run, in this order, with the seconds that each took."""

    def __init__(self, seconds: dict[str, float], last: Path) -> None:
        self.seconds, self.last = seconds, last
        self.order = {test: i for i, test in enumerate(seconds)}

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        from hypothesis import Phase, settings  # later than pytest's own look at it

        settings.register_profile("as drawn", settings(), phases=[Phase.explicit, Phase.generate])
        settings.load_profile("as drawn")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted((item for item in items if item.nodeid in self.order), key=lambda i: self.order[i.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, ALLOWED + 10 * self.seconds[item.nodeid])
        self.last.write_text(item.nodeid)
        result = yield
        signal.setitimer(signal.ITIMER_PROF, 0)
        return result


if __name__ == "__main__":
    seconds = json.loads(Path(sys.argv[1]).read_text())
    files = sorted({test.partition("::")[0] for test in seconds})
    options = ["-x", "-q", "-m", "", "--tb=line", "-p", "no:cacheprovider", "-p", "no:xdist"]
    sys.exit(pytest.main([*options, *files], plugins=[Selection(seconds, Path(sys.argv[2]))]))
