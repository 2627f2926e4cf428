"""Reference counts of labels: they depend on no machine, so a search that suddenly needs more of them has got worse.

``label_counts.json`` holds what the exact search and its approximations needed when they were last looked at.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

REFERENCE = Path(__file__).with_name("label_counts.json")
ALLOWED = 0.2  # more labels than that, in proportion, is a regression
COUNTED = ("labels_generated", "labels_expanded")
KEPT = (*COUNTED, "front", "edges")

Counts = Mapping[str, Mapping[str, int]]


def title(row: Mapping[str, Any]) -> str:
    """Return the name of a row, such as `m160 at 0.25 m, eps 0.01`."""
    return f"{row['instance']} at {row['step']:g} m" + (f", eps {row['eps']:g}" if row["eps"] else "")


def read(file: Path = REFERENCE) -> Counts:
    """Return the reference counts by title."""
    counts: Counts = json.loads(file.read_text())
    return counts


def write(rows: Iterable[Mapping[str, Any]], file: Path = REFERENCE) -> None:
    """Take the counts of these rows for reference; what was not searched keeps its own."""
    old = read(file) if file.exists() else {}
    new = {title(row): {name: row[name] for name in KEPT} for row in rows}
    lines = (f" {json.dumps(name)}: {json.dumps(counts)}" for name, counts in {**old, **new}.items())
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def regressions(rows: Iterable[Mapping[str, Any]], reference: Counts) -> list[str]:
    """One message for each search that needed too many labels; what has no reference is none."""
    return [
        f"{title(row)}: {name.replace('_', ' ')} {old[name]} -> {row[name]} ({row[name] / old[name] - 1:+.0%}, "
        f"allowed {ALLOWED:+.0%}); front {old['front']} -> {row['front']}, edges {old['edges']} -> {row['edges']}"
        for row in rows
        if (old := reference.get(title(row))) is not None
        for name in COUNTED
        if row[name] > (1 + ALLOWED) * old[name]
    ]
