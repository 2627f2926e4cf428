"""`make fuzz`: mutated inputs against every door of hpop, with fixed seeds; counts outcomes and failures by kind.

    python tests/fuzz [--seconds 240] [--seed 0] [--only TARGET ...] [--inputs N] [--first N] [--here] [--out FILE]

A failure is a traceback, a crash, a hang, memory beyond a limit, control characters in what a person is shown, or a
wrong answer. `--only TARGET --first N --inputs 1 --here` makes input N again, in this process, with its traceback.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

from harness import Tally, generator, run
from targets import TARGETS, warm


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=240.0, help="by the clock, for all targets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=TARGETS, default=list(TARGETS), metavar="TARGET")
    parser.add_argument("--inputs", type=int, help="of each target, at most")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--here", action="store_true", help="in this process")
    parser.add_argument("--out", type=Path, help="JSON file for the counts")
    given = parser.parse_args()
    out = given.out and given.out.absolute()
    tallies = {}
    with tempfile.TemporaryDirectory(prefix="hpop-fuzz-") as folder:
        os.chdir(folder)
        warm(Path(folder))
        for name in given.only:
            place = Path(folder, name)
            place.mkdir()
            if given.here:
                os.chdir(place)
                print(
                    name, given.first, TARGETS[name].attempt(generator(given.seed, TARGETS[name], given.first), place)
                )
                continue
            share = given.seconds * TARGETS[name].shares / sum(TARGETS[each].shares for each in given.only)
            tallies[name] = run(TARGETS[name], given.seed, place, seconds=share, inputs=given.inputs, first=given.first)
            print(line(name, tallies[name]), flush=True)
        os.chdir("/")
    inputs, failures = (sum(getattr(tally, kind) for tally in tallies.values()) for kind in ("inputs", "failures"))
    print(f"{inputs:,} inputs, {failures:,} failures")
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        counts = {name: {"outcomes": tally.outcomes, "first": tally.first} for name, tally in tallies.items()}
        out.write_text(json.dumps({"seed": given.seed, "targets": counts}, indent=1) + "\n")
    return int(failures > 0)


def line(name: str, tally: Tally) -> str:
    """Outcomes of a target in words, failures with the number of the first input that shows each."""
    kinds = [
        f"{count:,} {kind}" + (f" (first: {tally.first[kind]})" if kind in tally.first else "")
        for kind, count in tally.outcomes.most_common()
    ]
    return f"{name:>10}: {tally.inputs:>6,} inputs: {', '.join(kinds)}"


if __name__ == "__main__":
    sys.exit(main())
