"""Output of the list commands such as ``hpop criteria``, and of ``hpop explain``: words, and why a front is so."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from hpop.base import registry
from hpop.base.registry import GROUPS, Registry
from hpop.base.text import shown
from hpop.cli.glossary import entries
from hpop.cli.report import header, number, plain_table, print_wide
from hpop.cli.results import loaded, problem_of
from hpop.errors import HpopError, OptionError, UnknownName, did_you_mean


def print_criteria(console: Console | None = None) -> None:
    """Print the registered criteria by group."""
    console = console or Console()
    known: Sequence[Any] = list(registry.criteria.values())
    console.print("Criteria, all minimised: name, unit, how motions add up, parameters")
    for letter, group in GROUPS.items():
        members = sorted((c for c in known if c.group == letter), key=lambda c: str(c.name))
        if members:
            console.print(f"\n{letter}: {group}", style="bold", highlight=False)
        for cls in members:
            _print_entry(console, cls.name, declared(cls), _first_line(cls))


def declared(item: Any) -> str:
    """Describe a registered item in one line: its fields; for a criterion also unit, aggregate and requirements.

    If the name of a criterion does not say what it measures, ``quantity`` comes first. An export format has no fields;
    the line has the ending of its files.
    """
    parts = [_fields(item)] if dataclasses.is_dataclass(item) else [getattr(item, "suffix", "")]
    if hasattr(item, "aggregate"):
        requires = f"requires {', '.join(item.requires)}" if item.requires else ""
        parts = [item.quantity, "" if item.unit == "1" else item.unit, item.aggregate, requires, *parts]
    return ", ".join(filter(None, parts))


def print_models(console: Console | None = None) -> None:
    """Print the registered robots, their parameters, and the capabilities that criteria and planners may need."""
    console = console or Console()
    console.print("Models: name, parameters with their defaults, capabilities that criteria and planners may need")
    for name, cls in registry.models.items():
        _print_entry(console, name, _fields(cls), f"{_first_line(cls)} {_provided(cls)}".strip())


def print_goals(console: Console | None = None) -> None:
    """Print the registered goals and their parameters."""
    console = console or Console()
    console.print("Goals other than a single state: name, parameters with their defaults")
    for name, cls in registry.goals.items():
        _print_entry(console, name, _fields(cls), _first_line(cls))


def print_planners(console: Console | None = None) -> None:
    """Print the registered planners, their options, and the capabilities that they need of a robot."""
    console = console or Console()
    console.print("Planners: name, options with their defaults, capabilities that they need of a model")
    for name, cls in registry.planners.items():
        needs = ", ".join(sorted(cls.needs))
        _print_entry(console, name, _fields(cls), f"{_first_line(cls)} Needs {needs or 'nothing: any model will do'}.")


def print_formats(console: Console | None = None) -> None:
    """Print the export formats, with their file endings and axes."""
    console = console or Console()
    console.print("Formats of `hpop export`: name, ending of its files, axes")
    formats: dict[str, Any] = dict(registry.formats)
    for name, each in formats.items():
        _print_entry(console, name, each.suffix, f"{_first_line(each)} Axes: {each.axes}.")


def _provided(cls: type) -> str:
    """Return a sentence with the states and capabilities of a robot with default parameters; "" without defaults."""
    try:
        made = cls()
    except (TypeError, HpopError):
        return ""
    return f"States {made.space}. Provides {', '.join(sorted(made.provides))}."


def _print_entry(console: Console, name: str, declared: str, what: str) -> None:
    console.print(Padding(Text.assemble((name, "bold"), f"  {declared}"), (0, 0, 0, 2), expand=False))
    console.print(Padding(Text(what), (0, 0, 0, 6), expand=False))


def _fields(cls: Any) -> str:
    return ", ".join(f"{field.name}={_default(field)}" for field in dataclasses.fields(cls) if field.init)


def _default(field: dataclasses.Field[Any]) -> str:
    """Return the default of a field, or "..." for a field without one."""
    if field.default_factory is not dataclasses.MISSING:
        return repr(field.default_factory())
    return "..." if field.default is dataclasses.MISSING else repr(field.default)


def _first_line(cls: Any) -> str:
    """Return the first paragraph of a class's docstring, on one line, without markup."""
    text = " ".join((cls.__doc__ or "").strip().split("\n\n")[0].split())
    return re.sub(r":\w+:`|`", "", text)


REGISTRIES: tuple[Registry[Any], ...] = (
    registry.criteria,
    registry.planners,
    registry.models,
    registry.goals,
    registry.readers,
    registry.formats,
)


def explained(word: str) -> str:
    """Return the explanation of a word: its glossary entries, and the docstrings of registered classes of that name.

    Raises UnknownName, with similar words, if there is neither.
    """
    meant = _plain(word)
    found = [*_meanings(meant), *_registered(meant)]
    if not found:
        words = [name for entry in entries() for name in (entry.word, *entry.also)]
        names = [name for each in REGISTRIES for name in each]
        near = did_you_mean(meant, [*words, *names])
        raise UnknownName(f"unknown word {shown(word)}.{near} {known()}")
    return "\n\n".join(found)


def known() -> str:
    """Return a sentence that lists the words and names that `hpop explain` knows."""
    words = ", ".join(entry.word for entry in entries())
    *kinds, last = (each.kind for each in REGISTRIES)
    return f"`hpop explain` knows {words}; and the name of each {', '.join(kinds)} and {last}."


def _plain(word: str) -> str:
    """Normalise a word for look-up: ignore capitals, and treat dashes and underscores as blanks."""
    return re.sub(r"[\s_-]+", " ", word.strip().lower())


def _meanings(word: str) -> Iterator[str]:
    for entry in entries():
        if word in map(_plain, (entry.word, *entry.also)):
            yield f"{entry.word}: {entry.meaning}"


def _registered(word: str) -> Iterator[str]:
    for each in REGISTRIES:
        for name in each:
            if _plain(name) == word:
                item = each[name]
                text = re.sub(r":\w+:`~?([^`]+)`|``([^`]+)``", r"\1\2", inspect.cleandoc(item.__doc__ or ""))
                yield "\n".join(filter(None, [f"{name}, a {each.kind}: {declared(item)}".rstrip(": "), "", text]))


def print_why(
    folder: Path, through: str | None, wish: str | None, than: str | None, console: Console | None = None
) -> None:
    """Print why no path of a saved front passes somewhere, or has less of a cost, with the costs that are compared."""
    console = console or Console()
    path, front = loaded(folder)
    problem = problem_of(path, front)
    answer = front.why_not(through=through, wish=None if wish is None else _wish(wish), than=than, problem=problem)
    console.print(Text(answer.sentence))
    if answer.best is not None:
        table = plain_table()
        for words in (Text(), *map(header, front.names, front.units)):
            table.add_column(words, justify="right" if words.plain else "left", no_wrap=True)
        best, quanta = answer.best.costs, dict(zip(front.names, front.quanta.tolist(), strict=True))
        row = {name: best[name] - answer.numbers[name] for name in front.names}
        costs = {"best path": best, f"row {answer.row}": row, "difference": answer.numbers}
        for what, values in costs.items():
            cells = {name: number(values[name], quanta[name]) for name in front.names}
            signed = {
                name for name, cell in cells.items() if what == "difference" and values[name] > 0.0 and cell != "0"
            }
            table.add_row(what, *(f"+{cell}" if name in signed else cell for name, cell in cells.items()))
        print_wide(console, table)
    console.print(Text(f"{answer.front.certificate}"))


def _wish(text: str) -> str | dict[str, float]:
    """Return a wish in words, or the bound of "turns=3"; OptionError if the bound is no number."""
    name, equals, bound = text.partition("=")
    try:
        return {name.strip(): float(bound)} if equals else text
    except ValueError:
        raise OptionError(f"--wish must be words, or a bound such as turns=3, got {shown(text)}") from None
