"""`make mutants`: are deliberate faults noticed? The same faults in the package, one at a time, and the tests on each.

    python -m tests.mutants [--jobs 2] [--only N ...]   run the faults of faults.json, compare with what is recorded
    python -m tests.mutants --draw                      draw the faults anew (suites are compared by the same)
    python -m tests.mutants --record                    keep what this run found as what later ones are compared with
    --tree FOLDER --coverage FILE --durations FILE      another tree, what coverage and pytest (JUnit) said of its suite

Each fault goes into a copy of the tree with numba's caches of its own. The tests that reach it (reach.py) run cheapest
first, to the first failure; then the others of their files, some seconds of them, for a fixture may have reached it
for them. Faults that few tests reach come first. Results are kept one by one: a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from tests.mutants.faults import Fault, Site, applied, draw, sites
from tests.mutants.reach import Code, Seen

ROOT = Path(__file__).parents[2]
FAULTS = Path(__file__).with_name("faults.json")
OUT = ROOT / "out" / "mutants"
RESULTS = OUT / "results.json"
GONE = {"tests": 0, "result": "code gone", "by": "", "processor seconds": 0.0}
MISSED = ("survived", "not reached")
IMPORT = 2  # exit code of pytest where tests cannot be collected
SEED, COUNT = 12, 60
OTHERS = 15.0  # s, of tests that only stand beside those that reach a fault
#: Files that faults are drawn from, an equal share from each group.
GROUPS = {
    "search": ["hpop/search/**/*.py"],
    "criteria": ["hpop/criteria/**/*.py"],
    "frontier": ["hpop/frontier/*.py"],
    "readers": ["hpop/world/readers/*.py", "hpop/world/content/*.py", "hpop/scenario/yaml_lines.py"],
}


class Suite:
    """A tree, its tests with the seconds they take, and which of them reach what."""

    def __init__(self, root: Path, coverage: Path, durations: Path) -> None:
        self.root, self.code, self.seen = root, Code(root), Seen(coverage)
        self.seconds: dict[str, float] = {}
        for case in ET.parse(durations).iter("testcase"):
            module = case.get("classname", "")
            self.seconds[f"{module.replace('.', '/')}.py::{case.get('name')}"] = float(case.get("time", 0))

    def reaching(self, site: Site) -> tuple[list[str], list[str]]:
        """Return the tests that reach a site, and some others of their files, cheapest first."""
        file, line = site.fault.file, site.lines[0]
        if (name := self.code.unseen(file, line)) is None:
            tests = self.seen.tests((file, n) for n in site.lines)
            if not tests and site.fault.function:  # in a kernel within a function
                function = site.fault.function.partition(".")[0]
                tests = self.seen.tests(self.code.seen_lines(file, function))
        else:
            tests = self.seen.tests(self.code.seen_lines(file, name))
        tests &= self.seconds.keys()
        files = {test.partition("::")[0] for test in tests}
        others = self._by_cost(t for t in self.seconds if t.partition("::")[0] in files and t not in tests)
        total = 0.0
        for i, test in enumerate(others):
            total += self.seconds[test]
            if total > OTHERS:
                others = others[:i]
                break
        return self._by_cost(tests), others

    def cost(self, tests: Iterable[str]) -> float:
        """Seconds that tests take."""
        return sum(self.seconds[test] for test in tests)

    def _by_cost(self, tests: Iterable[str]) -> list[str]:
        return sorted(tests, key=lambda test: (self.seconds[test], test))


def copy(root: Path, to: Path) -> None:
    """Copy a tree with its compiled kernels."""
    for name in ("hpop", "tests", "examples", "docs", "benchmarks"):
        shutil.copytree(root / name, to / name)
    for path in [*root.glob("*.*"), *root.glob("[A-Z]*")]:
        if path.is_file() and not path.name.startswith("."):
            shutil.copy2(path, to)


def run(tree: Path, seconds: dict[str, float]) -> tuple[int, str, float]:
    """Run tests in a tree: exit code, the last test that began, processor seconds."""
    chosen, last = tree / "chosen.json", tree / "last.txt"
    chosen.write_text(json.dumps(seconds))
    last.touch()
    data = os.environ.get("HPOP_DATA", str((ROOT / ".." / "shared" / "data").resolve()))
    environment = os.environ | {"PYTHONPATH": str(tree), "HPOP_DATA": data, "TMPDIR": str(tree)}
    command = [sys.executable, "-P", str(Path(__file__).with_name("run.py")), str(chosen), str(last)]
    most = round(600 + 10 * sum(seconds.values()))  # processor seconds, of every process for itself
    with (tree / "said.txt").open("w") as said:
        process = subprocess.Popen(
            command,
            cwd=tree,
            env=environment,
            stdout=said,
            stderr=subprocess.STDOUT,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
        )
        _, status, usage = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code != 0 and not last.read_text():
        if "ERROR collecting" not in (told := (tree / "said.txt").read_text()):
            raise RuntimeError(told)
        code = IMPORT
    return code, last.read_text(), usage.ru_utime + usage.ru_stime


def result(suite: Suite, site: Site, tests: list[str], others: list[str]) -> dict[str, Any]:
    """Run the tests on one fault and return their verdict."""
    found: dict[str, Any] = {"tests": len(tests), "result": "not reached", "by": "", "processor seconds": 0.0}
    if not tests:
        return found
    with tempfile.TemporaryDirectory(prefix="hpop-mutant-") as folder:
        tree = Path(folder)
        copy(suite.root, tree)
        (tree / site.fault.file).write_text(applied((tree / site.fault.file).read_text(), site))
        # numba asks only whether a kernel's own file has changed: those that call a changed one compile again too.
        for file in suite.code.importers(site.fault.file):
            for cached in (tree / file).parent.glob(f"__pycache__/{Path(file).stem}.*.nb?"):
                cached.unlink()
        code, last, seconds = run(tree, {test: suite.seconds[test] for test in [*tests, *others]})
    found["processor seconds"] = round(seconds, 1)
    found["by"] = last
    found["result"] = "survived" if code == 0 else "caught"
    if code == 0:
        found["by"] = ""
    elif code < 0:
        found["by"] += " (stopped: too long)" if -code in (24, 27) else f" (signal {-code})"
    elif code == IMPORT:
        found["by"] = "an import"
    return found


def digest(root: Path) -> str:
    """Return a digest of every file that results depend on."""
    files = sorted(path for folder in ("hpop", "tests") for path in (root / folder).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]


def measured(root: Path) -> tuple[Path, Path]:
    """Run the whole suite once under coverage; give its data and durations."""
    OUT.mkdir(parents=True, exist_ok=True)
    data, durations = OUT / "coverage", OUT / "durations.xml"
    command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadfile", "-q", f"--junitxml={durations}"]
    command += ["--cov=hpop", "--cov-context=test", "--cov-report="]
    subprocess.run(command, cwd=root, env=os.environ | {"COVERAGE_FILE": str(data)}, check=True)
    return data, durations


def false_alarms(suite: Suite, found: Iterable[dict[str, Any]]) -> str:
    """Name the tests that noticed a fault and fail without one too."""
    noticed = {f["by"].partition(" (")[0]: 0.0 for f in found if "::" in f["by"]}
    with tempfile.TemporaryDirectory(prefix="hpop-mutant-") as folder:
        copy(suite.root, Path(folder))
        code, last, _ = run(Path(folder), {test: suite.seconds.get(test, 0.0) for test in noticed})
    return "the tests that noticed them pass without a fault" if code == 0 else f"fails without a fault: {last}"


def find(root: Path, fault: Fault) -> Site | None:
    """Return the place of a fault in a tree; None where its code no longer exists."""
    path = root / fault.file
    found = sites(path.read_text(), fault.file) if path.exists() else []
    return next((site for site in found if site.fault == fault), None)


def drawn(root: Path) -> list[dict[str, Any]]:
    """Return new faults, in their stored form."""
    files = {g: sorted({str(p.relative_to(root)) for t in ts for p in root.glob(t)}) for g, ts in GROUPS.items()}
    read = {name: (root / name).read_text() for names in files.values() for name in names}
    return [{"fault": fault._asdict()} for fault in draw(files, read, COUNT, SEED)]


def noticed(record: dict[str, Any], when: str) -> bool:
    """Return True if tests noticed a fault, now or when the baseline was recorded."""
    return record.get(when, GONE)["result"] == "caught"


def line(n: int, record: dict[str, Any]) -> str:
    """One row of the table."""
    fault, now = Fault(**record["fault"]), record["now"]
    note = f"equivalent: {record['equivalent']}" if "equivalent" in record else now["by"]
    was = record.get("baseline", {}).get("result", "")
    where = f"{fault.file.removeprefix('hpop/')} {fault.function}"
    change = f"{fault.before[:50]} -> {fault.after[:50]}".replace("\n", " ")
    return f"{n:2}  {now['result']:11} {was:11} {now['processor seconds']:6.0f} s  {where}: {change}  [{note}]"


def main() -> int:
    """Run the faults, print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", action="store_true")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="+")
    parser.add_argument("--tree", type=Path, default=ROOT)
    parser.add_argument("--coverage", type=Path)
    parser.add_argument("--durations", type=Path)
    options = parser.parse_args()
    if options.draw:
        FAULTS.write_text(json.dumps(drawn(options.tree), indent=1) + "\n")
        return 0
    records = json.loads(FAULTS.read_text())
    given = options.coverage and options.durations
    fingerprint = digest(options.tree)
    suite = Suite(options.tree, *((options.coverage, options.durations) if given else measured(options.tree)))
    OUT.mkdir(parents=True, exist_ok=True)
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    writing = Lock()
    places = {n: find(options.tree, Fault(**record["fault"])) for n, record in enumerate(records)}
    reaching = {n: suite.reaching(site) for n, site in places.items() if site is not None}

    def work(n: int) -> None:
        key = f"{n} {fingerprint}"
        found = kept.get(key) or (result(suite, places[n], *reaching[n]) if n in reaching else GONE)
        with writing:
            records[n]["now"] = kept[key] = found
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
            print(line(n, records[n]), flush=True)

    chosen = sorted(options.only or range(len(records)), key=lambda n: suite.cost(reaching.get(n, ([], []))[0]))
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(work, chosen))
    ran = [record for record in records if "now" in record]
    print(false_alarms(suite, [record["now"] for record in ran]))
    lost = [record for record in ran if noticed(record, "baseline") and record["now"]["result"] in MISSED]
    print(f"{sum(noticed(record, 'now') for record in ran)} of {len(ran)} noticed; lost: {len(lost)}")
    if options.record:
        kept_records = [{key: value for key, value in record.items() if key != "now"} for record in records]
        for record, kept_record in zip(records, kept_records, strict=True):
            kept_record |= {"baseline": record["now"]} if "now" in record else {}
        FAULTS.write_text(json.dumps(kept_records, indent=1) + "\n")
    return int(bool(lost))


if __name__ == "__main__":
    sys.exit(main())
