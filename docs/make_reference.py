"""Write what follows from the code, so that it is kept in one place.

``criteria_reference.md`` has every criterion that comes with hpop, from the registry and the docstrings,
``formats_reference.md`` every export format, ``options_reference.md`` every key and option of a scenario,
``glossary.md`` the words of ``hpop explain``; ``scenario.schema.json`` is what ``hpop schema`` prints.

Run it after one of these has changed: ``make reference``, or ``python docs/make_reference.py``.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path
from typing import Any

from hpop.base.registry import GROUPS, criteria, formats, goals, models
from hpop.cli import glossary
from hpop.scenario import json_schema

DOCS = Path(__file__).parent
HEAD = """# Reference of the criteria

For people who choose, compare or report criteria: each criterion with its formula, unit, source and parameters.
[Which criterion answers which question](questions.md) helps to choose, and [write a criterion](criteria.md) is the
guide to your own. `make reference` writes this page from the code; do not edit it.

All criteria are minimised and at least 0. The small tables say for each:

- *adds up by*: how the costs of motions become that of a trajectory. `sum`; `time-mean`, the sum divided by the
  duration; `max`, the worst moment; `trajectory`, computed with memory of the past.
- *requires*: what the robot or the world must have in any case; alternatives are named in the text.
- *smooth*: "yes" if the criterion has a gradient.
- *quantum*: the smallest difference that counts, in the unit.

In formulas, ∫ ... dt is the integral over the duration T of the trajectory, and (x)₊ is x if x is positive, else 0.
"""
AGGREGATES = {"sum": "sum", "time-mean": "time-mean", "max": "max (worst moment)", "trajectory": "trajectory (memory)"}


def schema() -> str:
    """Return the JSON schema of scenarios, without installed plugins."""
    return json_schema.written(json_schema.scenario_schema(at_home=True))


def reference() -> str:
    """Return the whole page on criteria."""
    known = [cls for cls in criteria.values() if cls.__module__.startswith("hpop.")]  # no plugin's
    parts = [HEAD]
    for letter, group in GROUPS.items():
        members = sorted((cls for cls in known if cls.group == letter), key=lambda cls: cls.name)
        if members:
            names = ", ".join(f"`{cls.name}`" for cls in members)
            parts += [f"## {letter}: {group}\n\n{names}\n", *map(entry, members)]
    return "\n".join(parts)


FORMATS = """# Export formats

For people who read exported files: the axes, units and columns of each format. [Export](export.md) is the guide.
`make reference` writes this page from the code; do not edit it.

In the table, a *body* is the part of the robot whose poses are exported, such as the camera. *Stamps* are the times of
messages. REP-103 is the convention of ROS for axes and units. In commands, `knee_70` stands for the name of your file:
the knee, row 70 of the front. Files hold the executed motion unless you export the planned one.
"""


def formats_reference() -> str:
    """Return the whole page on export formats."""
    known: dict[str, Any] = {name: one for name, one in formats.items() if one.__module__.startswith("hpop.")}
    rows = [{"format": f"`{name}`", "ending": f"`{one.suffix}`", "axes": one.axes} for name, one in known.items()]
    parts = [FORMATS, table(rows), ""]
    for name, one in known.items():
        said = text(inspect.cleandoc(one.__doc__)).removeprefix("Return ")
        parts.append(f"## `{name}`\n\n{said[0].upper()}{said[1:]}\n")
    return "\n".join(parts)


OPTIONS = """# Reference of options

For people who write scenarios or call planners: every key and option of a [scenario](command_line.md#scenarios), with
its default. "give it" marks what has none. An empty default means that the key is left out (None in Python): its
meaning says what then applies, or else there is no such limit, filter or part. Python has the same names. Lengths are
in m, times in s, angles in rad; in a scenario an angle may also be text such as `90 deg`. `make reference` writes this
page from the code; do not edit it.
"""
TOURS = (
    "Keys of `tour` ([guide](tours.md)). A stop has exactly one of `at`, `landmark`, and a [goal](#goals) by its name."
)
OPTION_SECTIONS = {"Maps": "world", "Robots": "model", "Planners": "planner", "Goals": "goal"}
ENTRIES = {"People": "people", "Landmarks": "landmarks", "Zones": "zones", "Measured fields": "fields"}


def options_reference() -> str:
    """Return the page on keys and options of scenarios."""
    whole = json_schema.scenario_schema(at_home=True)
    parts = [OPTIONS, "## Keys of a scenario\n", f"{options(whole, 'key')}\n"]
    for title, key in OPTION_SECTIONS.items():
        parts.append(f"## {title}\n")
        described, forms = named_forms(whole["definitions"][key])
        for name in sorted(forms):
            form = next((one for one in forms[name].get("anyOf", [forms[name]]) if "properties" in one), {})
            said = described.get(name) or form.get("description") or json_schema.summary({**models, **goals}[name])
            parts.append(f"### `{name}`\n\n{text(said)}\n")
            if form.get("properties"):
                parts.append(f"{options(form, 'option')}\n")
    for title, key in ENTRIES.items():
        parts.append(f"## {title}\n")
        form = whole["definitions"][key]
        for one in form.get("anyOf", [form]):
            parts.append(f"{text(one.get('description', ''))}\n\n{options(one, 'key')}\n")
    tour = whole["properties"]["tour"]
    stop = tour["properties"]["stops"]["items"]
    own = {name: said for name, said in stop["properties"].items() if name not in goals}
    parts.append(f"## Tours\n\n{TOURS}\n\n{options(tour, 'key')}\n\nKeys of a stop:\n")
    parts.append(f"{options({'properties': own}, 'key')}\n")
    return "\n".join(parts)


def named_forms(section: dict[str, Any]) -> tuple[dict[str, str], dict[str, Any]]:
    """Return what each name of a section of the schema is, and the schema of its options."""
    alternatives = section.get("anyOf", [section])
    described = {one["const"]: one.get("description", "") for one in alternatives if "const" in one}
    forms = {name: form for one in alternatives for name, form in one.get("properties", {}).items()}
    return described, forms


def options(form: dict[str, Any], title: str) -> str:
    """Return the properties of one object of the schema as a table."""
    needed = form.get("required", ())
    rows = []
    for name, said in form["properties"].items():
        default = f"`{number(said['default'])}`" if "default" in said else "give it" if name in needed else ""
        rows.append(
            {
                title: f"`{name}`",
                "default": default,
                "meaning": meaning(said.get("description", "")),
            }
        )
    return table(rows)


def meaning(said: str) -> str:
    """Return a description as one cell: no line breaks, and readers by the names that scenarios use.

    >>> meaning("As :func:`hpop.world.readers.drawing.read_dxf` has it.")
    'As the reader `dxf` has it.'
    """
    reader = r"`hpop\.world\.readers\.(?:\w+\.read_)?(\w+?)(?:\.read)?`"
    return re.sub(reader, r"the reader `\1`", re.sub(r"\s+", " ", text(said)))


def entry(cls: Any) -> str:
    """One criterion: what it declares, its parameters, its docstring."""
    declared = {
        "unit": cls.unit,
        "adds up by": AGGREGATES[cls.aggregate],
        "requires": ", ".join(cls.requires) or "nothing",
        "smooth": "yes" if cls.smooth else "no",
        "quantum": f"{cls.quantum:g}",
    }
    if cls.world_frame:
        declared["world frame"] = "contains a direction or a place"
    listed, docstring = listed_meanings(
        inspect.cleandoc(cls.__doc__), {field.name for field in dataclasses.fields(cls)}
    )
    tables = [table([declared])]
    if dataclasses.fields(cls):
        tables.append(table(parameters(cls, listed)))
    return "\n\n".join([f"### `{cls.name}`", *tables, text(docstring)]) + "\n"


def listed_meanings(docstring: str, names: set[str]) -> tuple[dict[str, str], str]:
    r"""Return the meanings of parameters that a docstring lists, and the docstring without this list.

    >>> listed_meanings("Gap.\n\nnear, far  m  limits of\n              the gap\n\nUnit m.", {"near", "far"})
    ({'near': 'm, limits of the gap', 'far': 'm, limits of the gap'}, 'Gap.\n\nUnit m.')
    """
    meanings, kept = dict[str, str](), []
    for paragraph in docstring.split("\n\n"):
        lines = re.findall(r"^(\w+(?:, \w+)*) {2,}(\S.*(?:\n {3,}.*)*)", paragraph, re.MULTILINE)
        listed = {name: said for names_, said in lines for name in names_.split(", ")}
        if not listed or not listed.keys() <= names:
            kept.append(paragraph)
            continue
        for name, said in listed.items():
            meanings[name] = re.sub(r" {2,}", ", ", re.sub(r"\n +", " ", said)).replace("``", "`")
    return meanings, "\n\n".join(kept)


def table(rows: list[dict[str, str]]) -> str:
    """Rows with the same keys, as Markdown."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *(list(row.values()) for row in rows)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def parameters(cls: Any, listed: dict[str, str]) -> list[dict[str, str]]:
    """Return name, default and meaning of each field; the meaning stands in the docstring, or behind the field."""
    source = "\n".join(inspect.getsource(one) for one in cls.__mro__ if dataclasses.is_dataclass(one))
    rows = []
    for field in dataclasses.fields(cls):
        if not field.init:  # it is computed
            continue
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        shown = "none; give it" if default is dataclasses.MISSING else number(default)
        said = re.search(rf"^ +{field.name}: .*?  # (.+)$", source, re.MULTILINE)
        meaning = listed.get(field.name) or (said.group(1).replace("``", "`") if said else "")
        meaning = re.sub(r":[a-z]+:`[~.]?([^`]+)`", r"`\1`", meaning)
        rows.append({"parameter": f"`{field.name}`", "default": shown, "meaning": meaning})
    if not any(row["meaning"] for row in rows):
        rows = [{key: row[key] for key in ("parameter", "default")} for row in rows]
    return rows


def number(value: Any) -> str:
    """Return a default as a reader would write it.

    >>> number(0.1), number(None), number("walk")
    ('0.1', 'None', "'walk'")
    """
    return f"{value:g}" if isinstance(value, float) else repr(value)


def text(docstring: str) -> str:
    """Return a docstring as Markdown: names in code, aligned lists kept as they are.

    >>> text("``k`` of :class:`hpop.World`")
    '`k` of `hpop.World`'
    """
    paragraphs = []
    for paragraph in docstring.split("\n\n"):
        if re.match(r"\w+(, \w+)* {2,}\S", paragraph):
            paragraphs.append(f"```text\n{paragraph}\n```")
            continue
        marked = re.sub(r":\w+:`([^`]+)`", r"`\1`", paragraph).replace("``", "`").replace("*", "\\*")
        paragraphs.append(marked.replace("](", "] ("))
    return "\n\n".join(paragraphs)


PAGES = {
    "criteria_reference.md": reference,
    "formats_reference.md": formats_reference,
    "glossary.md": glossary.page,
    "options_reference.md": options_reference,
    "scenario.schema.json": schema,
}

if __name__ == "__main__":
    for name, write in PAGES.items():
        (DOCS / name).write_text(write(), encoding="utf-8")
