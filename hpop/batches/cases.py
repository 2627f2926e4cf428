"""Cases of a batch (a problem with the planners that solve it), from a specification file or from Python objects."""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import yaml

from hpop.base.lazy import library
from hpop.base.text import shown
from hpop.errors import HpopError, OptionError, QueryError, ScenarioError
from hpop.planners.base import Planner, PlannerSpec, make_planner
from hpop.problems.front import question_of
from hpop.problems.problem import Problem
from hpop.scenario import Scenario, read_scenario
from hpop.scenario.yaml_lines import Document, Place
from hpop.world import World

VARY, TABLE = "vary", "table"
MOST_CASES = 200_000
LETTERS = 16  # number of hexadecimal digits of an identifier
ENDS = ("start", "goal")


@dataclass(frozen=True)
class Case:
    """Case of a batch: a problem with the planners that solve it together.

    number   index in the batch, from 0
    id       digest of the problem and its planners, by which a resumed batch recognises the case
    problem  digest of the problem alone, shared by cases that compare planners on this problem
    world    digest of everything but start, goal and planners: cases that share it are solved one after the other
    planner  label, such as ``lattice(step=0.5)``
    values   values of the varied keys, by dotted key; the name of a problem is under ``name``
    """

    number: int
    id: str
    problem: str
    world: str
    planner: str
    values: Mapping[str, Any] = field(default_factory=dict)


class Cases(Protocol):
    """Interface of a collection of cases; each case can be built into its problem and planners."""

    def __len__(self) -> int:
        """Return the number of cases."""
        ...

    def __iter__(self) -> Iterator[Case]:
        """Yield the cases in their order."""
        ...

    def build(self, case: Case) -> tuple[Problem, tuple[Planner, ...]]:
        """Return the problem and the planners of a case; raises HpopError if they are invalid."""
        ...


@dataclass(frozen=True, eq=False)
class Specification:
    """Cases from a scenario file in which some keys vary: every combination of their values is a case.

    A table is one more axis: each of its rows is combined with all values of the varied keys.

    ::

        world: {geojson: {path: museum.geojson}}
        criteria: [exposure, turns, length]    # equal in all cases
        table: pairs.csv                       # columns such as start.x and goal.x: a row varies several keys
        vary:
          planner: [lattice, {roadmap: {samples: 500}}]
          world.geojson.path: maps/*.geojson   # a pattern of files, relative to the folder of this file
          model.differential_drive.radius: [0.2, 0.3]

    document   content of the file without ``vary`` and ``table``
    axes       one axis for each varied key: its values, each as a mapping {dotted key: value}. With a table, one more
               axis before them: its rows, each as a mapping with several keys
    has_table  whether the first axis is that of a table
    """

    document: Document
    axes: tuple[tuple[Mapping[str, Any], ...], ...]
    has_table: bool = False
    _worlds: dict[str, World] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | Path) -> Specification:
        """Read a specification file; raise ScenarioError for invalid keys and values."""
        document = Document(Path(path))
        values = dict(document.values)
        vary, table = values.pop(VARY, {}), values.pop(TABLE, None)
        folder = document.path.parent
        if not isinstance(vary, dict) or not (vary or table):
            raise ScenarioError(
                f"{document.where((VARY,))}: expected keys with lists of values, such as `planner: [lattice, "
                f"roadmap]`, or a table of starts and goals; got {shown(vary)}. `hpop plan` plans a single scenario"
            )
        axes: list[tuple[Mapping[str, Any], ...]] = [
            tuple({str(key): value} for value in _varied_values(document, str(key), given, folder))
            for key, given in vary.items()
        ]
        if table is not None:
            axes.insert(0, _table_rows(document, table, folder))
        specification = cls(document.with_values(values), tuple(axes), table is not None)
        if len(specification) > MOST_CASES:
            raise ScenarioError(f"{path}: {len(specification):,} combinations, more than {MOST_CASES:,}; vary less")
        specification.check()
        return specification

    def __len__(self) -> int:
        return math.prod(map(len, self.axes))

    def __iter__(self) -> Iterator[Case]:
        for number, chosen in enumerate(itertools.product(*self.axes)):
            values = {key: value for part in chosen for key, value in part.items()}
            given = self._scenario_values(values)
            planner = given.get("planner")
            question = {key: value for key, value in given.items() if key != "planner"}
            world = {key: value for key, value in question.items() if key not in ENDS}
            yield Case(number, digest(given), digest(question), digest(world), planner_label(planner), values)

    def build(self, case: Case) -> tuple[Problem, tuple[Planner, ...]]:
        """Build the problem and the planners of a case; raise HpopError if they are invalid."""
        scenario = self._build_scenario(case.values)
        return scenario.problem, scenario.planners

    def check(self) -> None:
        """Build the scenario once for each varied value, so that errors are reported before planning begins.

        Of a table, only the first row is built. If a key of the start or goal varies, an invalid start or goal is not
        reported here, but in the results of its case.
        """
        first = {key: value for axis in self.axes for key, value in axis[0].items()}
        for place, axis in enumerate(self.axes):
            rows_of_table = self.has_table and place == 0
            for part in axis[:1] if rows_of_table else axis:
                try:
                    self._build_scenario({**first, **part})
                except QueryError:
                    if not any(key.split(".")[0] in ENDS for key in first):
                        raise

    def _build_scenario(self, values: Mapping[str, Any]) -> Scenario:
        """Build the scenario with values at their dotted keys; faults report the line of the varied key."""
        sources = {_key_path(key): (VARY, key) if (VARY, key) in self.document else (TABLE,) for key in values}
        return read_scenario(self.document.with_values(self._scenario_values(values), sources), self._worlds)

    def _scenario_values(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the content of the scenario file, with values set at their dotted keys.

        A start or goal with varied keys has these keys only; the file's other keys of it are dropped.
        """
        scenario: dict[str, Any] = json.loads(self._text)
        for key in ENDS:
            if any(name.startswith(f"{key}.") for name in values):
                scenario[key] = {}
        for key, value in values.items():
            _set_value(self.document, scenario, key.split("."), value)
        return scenario

    @cached_property
    def _text(self) -> str:
        """Content of the scenario file as JSON text, from which each case starts."""
        return json.dumps(self.document.values)


def _key_path(key: str) -> Place:
    """Convert a dotted key, such as ``start.x``, to a tuple of keys and list indices."""
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


def _set_value(document: Document, into: Any, keys: Sequence[str], value: Any) -> None:
    """Set a value in the scenario ``into``, in place, under a path of keys.

    A bare name on the way, such as ``lattice``, becomes a mapping, ``{lattice: {}}``.
    """
    here, place = into, ".".join(keys)
    for key, following in itertools.pairwise(keys):
        index: Any = int(key) if isinstance(here, list) and key.isdecimal() else key
        try:
            inner = here.get(index) if isinstance(here, dict) else here[index]
        except (LookupError, TypeError):
            raise ScenarioError(
                f"{document.where((VARY,))}: {place}: the scenario has no {key!r} to vary; correct the key"
            ) from None
        if inner is None or inner == following:
            inner = {} if inner is None else {following: {}}
        if not isinstance(inner, dict | list):
            raise ScenarioError(
                f"{document.where((VARY,))}: {place} varies a part of {key!r}, which is {shown(inner)}; write it as "
                f"{{{following}: ...}}, or vary {key!r} as a whole"
            )
        here[index] = inner
        here = inner
    last: Any = int(keys[-1]) if isinstance(here, list) and keys[-1].isdecimal() else keys[-1]
    try:
        here[last] = value
    except (LookupError, TypeError):
        raise ScenarioError(
            f"{document.where((VARY,))}: {place}: the scenario has no {keys[-1]!r} to vary; correct the key"
        ) from None


def _varied_values(document: Document, key: str, given: Any, folder: Path) -> Sequence[Any]:
    """Return the values of a varied key: the given list, or the files that match a given pattern."""
    if isinstance(given, str) and glob.has_magic(given):
        files = sorted(glob.glob(given, root_dir=folder, recursive=True))
        if not files:
            raise ScenarioError(
                f"{document.where((VARY, key))}: no file in {folder} matches {given!r}; correct the pattern"
            )
        return files
    if not isinstance(given, list) or not given:
        raise ScenarioError(
            f"{document.where((VARY, key))}: expected a list of values, or a pattern of files such as "
            f"maps/*.geojson; got {shown(given)}"
        )
    return given


def _table_rows(document: Document, given: Any, folder: Path) -> tuple[Mapping[str, Any], ...]:
    """Return the rows of a table file (.csv or .parquet) as values by dotted key; empty cells are left out."""
    where = document.where((TABLE,))
    if not isinstance(given, str) or not given.endswith((".csv", ".parquet")):
        raise ScenarioError(f"{where}: expected a .csv or .parquet file, got {shown(given)}")
    try:
        if given.endswith(".csv"):
            rows = _csv_rows(folder / given)
        else:
            rows = library("pyarrow.parquet", "a Parquet table").read_table(folder / given).to_pylist()
    except OSError as error:
        raise ScenarioError(
            f"{where}: cannot read {given}: {error.strerror or error}; its path counts from the folder of this file"
        ) from None
    except (ValueError, yaml.YAMLError) as error:
        raise ScenarioError(f"{where}: cannot read the table {given}: {error}") from None
    cells = tuple({key: value for key, value in row.items() if value is not None} for row in rows)
    if not cells:
        raise ScenarioError(f"{where}: {given} has no rows; write a row for each combination of values to plan")
    return cells


def _csv_rows(path: Path) -> list[dict[str, Any]]:
    """Read a CSV file; the cells are parsed as YAML values."""
    import csv

    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file)
        header = [name.strip() for name in next(reader, [])]
        if not header or not all(header) or len(set(header)) < len(header):
            raise ValueError("its first line must name each column, such as start.x, and each name once")
        rows = []
        for cells in reader:
            if len(cells) != len(header):
                raise ValueError(f"line {reader.line_num} has {len(cells)} cells for {len(header)} columns")
            rows.append({name: yaml.safe_load(cell) for name, cell in zip(header, cells, strict=True)})
        return rows


@dataclass(frozen=True, eq=False)
class OfProblems:
    """Cases from Python objects: every problem is solved by every planner."""

    problems: Sequence[tuple[str, Problem]]
    planners: Sequence[tuple[str, Planner]]

    @classmethod
    def of(
        cls,
        problems: Iterable[Problem] | Mapping[str, Problem],
        planners: PlannerSpec | Sequence[PlannerSpec] | Mapping[str, PlannerSpec],
    ) -> OfProblems:
        """Create the cases of some problems and planners, each given as a list or as a mapping from names."""
        named = problems.items() if isinstance(problems, Mapping) else (("", problem) for problem in problems)
        found = [(str(name), problem) for name, problem in named]
        wrong = next((problem for _, problem in found if not isinstance(problem, Problem)), None)
        if wrong is not None or not found:
            raise OptionError(f"problems must be one or more hpop.Problem objects, got {shown(wrong or found)}")
        if isinstance(planners, Mapping) and not _is_planner_spec(planners):
            by_label: Mapping[str, Any] = planners
            return cls(found, [(str(name), make_planner(spec)) for name, spec in by_label.items()])
        single = isinstance(planners, str | Mapping) or not isinstance(planners, Sequence)
        specs: Sequence[Any] = [planners] if single else planners  # type: ignore[assignment]
        return cls(found, [(planner_label(spec), make_planner(spec)) for spec in specs])

    def __len__(self) -> int:
        return len(self.problems) * len(self.planners)

    def __iter__(self) -> Iterator[Case]:
        for row, (name, problem) in enumerate(self.problems):
            described = question_of(problem.describe())
            question = digest(described)
            world = digest({key: value for key, value in described.items() if key not in ENDS})
            for column, (planner_label, planner) in enumerate(self.planners):
                number = row * len(self.planners) + column
                yield Case(number, digest([question, repr(planner)]), question, world, planner_label, {"name": name})

    def build(self, case: Case) -> tuple[Problem, tuple[Planner, ...]]:
        """Return the problem and the planner of a case."""
        row, column = divmod(case.number, len(self.planners))
        return self.problems[row][1], (self.planners[column][1],)


def _is_planner_spec(planners: Mapping[str, Any]) -> bool:
    """Return whether a mapping describes one planner with its options, rather than several planners by label."""
    try:
        make_planner(planners)
    except HpopError:
        return False
    return True


def digest(value: Any) -> str:
    """Return a short hash of a JSON value, used as its identifier."""
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:LETTERS]


def planner_label(planner: Any) -> str:
    """Return a readable label of a planner, or of several planners that solve a problem together.

    >>> planner_label({"lattice": {"step": 0.5}}), planner_label(["lattice", "roadmap"]), planner_label(None)
    ('lattice(step=0.5)', 'lattice + roadmap', 'lattice')
    """
    if planner is None:
        return "lattice"
    if isinstance(planner, str):
        return planner
    if isinstance(planner, list | tuple):
        return " + ".join(map(planner_label, planner))
    if isinstance(planner, Mapping) and len(planner) == 1:
        ((name, options),) = planner.items()
        if not options:
            return str(name)
        return f"{name}({', '.join(f'{key}={value}' for key, value in options.items())})"
    given = {
        f.name: value
        for f in (fields(planner) if hasattr(planner, "__dataclass_fields__") else ())
        if f.init and (value := getattr(planner, f.name)) != f.default
    }
    return planner_label({getattr(planner, "name", type(planner).__name__): given})
