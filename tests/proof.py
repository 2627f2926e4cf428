"""`make proof`: the suite at its largest, part by part, and a table of what is proven for these very files.

    python tests/proof.py [PART ...]

Every test runs, those marked `proof` too, and hypothesis draws its `proof` profile (tests/conftest.py). A part that
passed is not run again until a file of the package or of the tests changes: a run that was stopped goes on where it
was. Naming parts runs these alone, and again. Ends with 1 where a part failed.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "out" / "proof"

#: The tests of each part: files and folders of tests/, and modules whose docstrings are run. Together they are all.
PARTS = {
    "search": ["tests/search"],
    "planners": ["tests/planners"],
    "criteria": ["tests/criteria"],
    "frontier": ["tests/frontier"],
    "models": ["tests/models"],
    "goals": ["tests/goals"],
    "drive": ["tests/drive"],
    "batches": ["tests/batches"],
    "study": ["tests/study"],
    "world": ["tests/world"],
    "view": ["tests/view"],
    "cli": ["tests/cli", "tests/scenario"],
    "motions": ["tests/motions"],
    "problems": ["tests/problems"],
    "trajectories": ["tests/trajectories"],
    "export": ["tests/export"],
    "ros": ["tests/ros"],
    "preference": ["tests/preference"],
    "browser": ["tests/browser"],
    "testing": ["tests/testing"],
    "package": [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("tests/test_*.py"))] + ["hpop"],
}


def state() -> str:
    """Digest of every file that a result depends on."""
    digest = hashlib.sha256()
    files = [ROOT / "pyproject.toml", ROOT / "constraints.txt"]
    for folder in ("hpop", "tests", "examples", "docs", "benchmarks"):
        files += [path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    for path in sorted(files):
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def passed_before(part: str, now: str) -> dict[str, Any] | None:
    """Record of a part that passed for these very files."""
    try:
        record: dict[str, Any] = json.loads((RESULTS / f"{part}.json").read_text())
    except FileNotFoundError:
        return None
    return record if (record["state"], record["exit code"]) == (now, 0) else None


def prove(part: str, now: str) -> dict[str, Any]:
    """Run all tests of one part and record what came of it."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    report = RESULTS / f"{part}.xml"
    command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadfile", "-q", "-m", ""]
    command += ["--hypothesis-profile=proof", f"--junitxml={report}", *PARTS[part]]
    report.unlink(missing_ok=True)
    before, begin = os.times(), time.monotonic()
    done = subprocess.run(command, cwd=ROOT, check=False)
    after = os.times()
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    suite = ET.parse(report).getroot().find("testsuite") if report.exists() else None
    counts = {key: int(suite.get(key, 0)) if suite is not None else 0 for key in ("tests", "failures", "errors")}
    record = {"part": part, "state": now, "exit code": done.returncode, **counts}
    record |= {"processor seconds": round(seconds), "wall seconds": round(time.monotonic() - begin)}
    (RESULTS / f"{part}.json").write_text(json.dumps(record, indent=1) + "\n")
    return record


def table(records: dict[str, dict[str, Any]]) -> str:
    """One line a part: what it holds and whether it is proven."""
    lines = [f"{'part':10} {'tests':>6} {'processor s':>12} {'wall s':>7}  result"]
    for part in PARTS:
        if (record := records.get(part)) is None:
            lines.append(f"{part:10} {'':6} {'':12} {'':7}  not run for these files")
            continue
        bad = record["failures"] + record["errors"]
        result = (
            "passed" if record["exit code"] == 0 else f"{bad} failed" if bad else f"exit code {record['exit code']}"
        )
        cells = f"{record['tests']:6} {record['processor seconds']:12} {record['wall seconds']:7}"
        lines.append(f"{part:10} {cells}  {result}")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Prove the parts named, or all that are not proven yet."""
    unknown = [part for part in arguments if part not in PARTS]
    if unknown:
        print(f"parts are {', '.join(PARTS)}; got {', '.join(unknown)}", file=sys.stderr)
        return 2
    now = state()
    records = {part: record for part in PARTS if (record := passed_before(part, now))}
    for part in arguments or [part for part in PARTS if part not in records]:
        print(f"== {part}", flush=True)
        records[part] = prove(part, now)
    print(table(records))
    return int(any(record["exit code"] for record in records.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
