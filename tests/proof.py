"""`make proof`: the suite at its largest, part by part, and a table of what is proven for these very files.

    python tests/proof.py [PART ...]

Every test runs, those marked `proof` too, and hypothesis draws its `proof` profile (tests/conftest.py). Two parts run
at a time, the longest first, each in one process: two processes for one part would both import and collect, and one of
them would wait for the other at the end. The output of a part is in `out/proof/PART.txt`; its end is printed if the
part failed.

A part that passed is not run again until a file of the package or of the tests changes: a run that was stopped goes on
where it was. Naming parts runs these alone, and again. Ends with 1 where a part failed.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "out" / "proof"

#: The tests of planners in three parts: planners on graphs, planners that solve programs, and all others.
GRAPHS = [f"tests/planners/{name}" for name in ("graphs", "lattice", "roadmap", "timed")]
PROGRAMS = [f"tests/planners/{name}" for name in ("epsilon_constraint", "programs", "smoothing", "spline")]

#: The tests of each part: files and folders of tests/, and modules whose docstrings are run. Together they are all.
#: Those that take longest come first.
PARTS = {
    "search": ["tests/search"],
    "preference": ["tests/preference"],
    "programs": PROGRAMS,
    "graphs": GRAPHS,
    "planners": ["tests/planners", *(f"--ignore={folder}" for folder in (*GRAPHS, *PROGRAMS))],
    "drive": ["tests/drive"],
    "models": ["tests/models"],
    "browser": ["tests/browser"],
    "package": [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("tests/test_*.py"))] + ["hpop"],
    "cli": ["tests/cli", "tests/scenario"],
    "criteria": ["tests/criteria"],
    "study": ["tests/study"],
    "view": ["tests/view"],
    "frontier": ["tests/frontier"],
    "world": ["tests/world"],
    "export": ["tests/export"],
    "testing": ["tests/testing"],
    "motions": ["tests/motions", "tests/trajectories"],
    "problems": ["tests/problems", "tests/goals"],
    "batches": ["tests/batches", "tests/benchmark", "tests/ros"],
    "live": ["tests/live", "tests/simulation"],
}


def state() -> str:
    """Return the digest of every file that a result depends on."""
    digest = hashlib.sha256()
    files = [ROOT / "pyproject.toml", ROOT / "constraints.txt"]
    for folder in ("hpop", "tests", "examples", "docs", "benchmarks"):
        files += [path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    for path in sorted(files):
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def passed_before(part: str, now: str) -> dict[str, Any] | None:
    """Return the record of a part that passed for these very files."""
    try:
        record: dict[str, Any] = json.loads((RESULTS / f"{part}.json").read_text())
    except FileNotFoundError:
        return None
    return record if (record["state"], record["exit code"]) == (now, 0) else None


def prove(part: str, now: str) -> dict[str, Any]:
    """Run all tests of one part in a process, and record what came of it."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    report, output = RESULTS / f"{part}.xml", RESULTS / f"{part}.txt"
    command = [sys.executable, "-m", "pytest", "-p", "no:xdist", "-q", "-m", ""]
    command += ["-o", "faulthandler_timeout=3600", "--hypothesis-profile=proof", f"--junitxml={report}", *PARTS[part]]
    report.unlink(missing_ok=True)
    begin = time.monotonic()
    with output.open("w") as file:
        process = subprocess.Popen(command, cwd=ROOT, stdout=file, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)  # which counts the processor time of this process alone
    process.returncode = os.waitstatus_to_exitcode(status)
    suite = ET.parse(report).getroot().find("testsuite") if report.exists() else None
    counts = {key: int(suite.get(key, 0)) if suite is not None else 0 for key in ("tests", "failures", "errors")}
    record = {"part": part, "state": now, "exit code": process.returncode, **counts}
    record["processor seconds"] = round(usage.ru_utime + usage.ru_stime)
    record["wall seconds"] = round(time.monotonic() - begin)
    (RESULTS / f"{part}.json").write_text(json.dumps(record, indent=1) + "\n")
    print(table({part: record}, [part]), flush=True)
    if process.returncode:
        print(*output.read_text().splitlines()[-60:], f"All of it is in {output}", sep="\n", flush=True)
    return record


def table(records: dict[str, dict[str, Any]], parts: Iterable[str] = PARTS) -> str:
    """Return one line a part: its tests, its time and whether it is proven."""
    lines = [f"{'part':10} {'tests':>6} {'processor s':>12} {'wall s':>7}  result"]
    for part in parts:
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
    parts = arguments or [part for part in PARTS if part not in records]
    with ThreadPoolExecutor(2) as two:
        records |= zip(parts, two.map(lambda part: prove(part, now), parts), strict=True)
    print(table(records))
    return int(any(record["exit code"] for record in records.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
