"""Ctrl-C while a front of 1,500 points is searched for: what the process still does until the prompt is back.

Counted in seconds of its processor, which a busy machine changes little: it took 12 to 20 of them once, for pictures.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from hpop.problems.front import Front
from tests.warm import Warm
from tests.worlds import pillars

POINTS = 1500
MOST = 1.5  # processor seconds; .4 on an idle machine
#: `hpop plan` that presses Ctrl-C itself, when the search reports so many points, and counts from then on.
INTERRUPTED = f"""\
import signal, time
import hpop.cli.beside, hpop.runtime.limits
from hpop.entry import main
hpop.cli.beside.PicturesBeside._begin = lambda pictures, which: print(which, "is drawn beside")
described, begun = hpop.runtime.limits.described, []

def interrupting(progress):
    if progress.front >= {POINTS} and not begun:
        begun.append(time.process_time())
        signal.raise_signal(signal.SIGINT)
    return described(progress)

hpop.runtime.limits.described = interrupting
try:
    main()
finally:
    print("processor seconds:", time.process_time() - begun[0])
"""


class Ended(NamedTuple):
    """A process that has ended: exit code, what it printed, the folder that it wrote."""

    code: int
    lines: list[str]
    folder: Path


@pytest.fixture(scope="module")
def ended(warm: Warm, tmp_path_factory: pytest.TempPathFactory) -> Ended:
    folder = tmp_path_factory.mktemp("hall")
    content = pillars() | {
        "criteria": ["exposure", "turns", "length", "rotation", "proximity", "clearance"],
        "planner": {"lattice": {"step": 0.33, "max_turns": 1000}},
    }
    (folder / "hall.yaml").write_text(yaml.safe_dump(content))
    done = warm.run("plan", "hall.yaml", "--out", "out", cwd=folder, code=INTERRUPTED)
    return Ended(done.returncode, done.stdout.splitlines(), folder / "out")


def test_the_prompt_is_back_soon(ended: Ended) -> None:
    assert ended.code == 130
    assert float(ended.lines[-1].removeprefix("processor seconds: ")) < MOST


def test_the_file_holds_what_was_found_and_the_table_is_printed(ended: Ended) -> None:
    front = Front.load(ended.folder / "front.json")
    assert (front.status, len(front) >= POINTS) == ("interrupted", True)
    assert f"{len(front):,} trajectories; status: interrupted" in ended.lines
    assert any(line.startswith("The marked trajectories") for line in ended.lines)


def test_pictures_are_left_to_another_process(ended: Ended) -> None:
    assert [path.name for path in ended.folder.iterdir()] == ["front.json"]
    last = "written to out: front.json; pictures are being drawn in the background"
    assert ended.lines[-3:-1] == ["all is drawn beside", last]
