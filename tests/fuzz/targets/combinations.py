"""Random combinations of what is allowed, planned and used: what comes of them is right, in time and within memory.

A front with a dominated row cannot be made (:class:`hpop.frontier.ItemFront` raises), so it counts as a traceback.
"""

from __future__ import annotations

import dataclasses
import heapq
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import shapely
from harness import Wrong
from mutations import Rng
from verdicts import asked, shown

import hpop
from hpop.frontier.strict_json import plain
from hpop.planners.base import make_planner
from hpop.planners.objectives import edge_objectives
from hpop.problems.verify import verify
from hpop.runtime import compiled
from hpop.runtime.limits import Status
from hpop.scenario import Scenario, load_scenario
from hpop.search import Graph, pareto_paths
from targets import allowed
from targets.given import as_yaml, command

DOOR = 0.25  # share of fronts with which each thing is done
DRAWS = 6  # scenarios, until one is no question that makes no sense
TIMES, SLACK = 3.0, 3.0  # a run longer than so many limits, and so many s of processor time, hangs
ROOM = 200 * 1024**2  # bytes that a run may take besides 1.5 times its max_memory
MOST_STEPS = 20_000  # of the oracle: on larger graphs nothing is compared
COUNTED = {"max_labels", "max_memory", "time_limit"}


def combination(rng: Rng, folder: Path) -> str:
    """Plan a random scenario, look at its front, and try some of what is done with fronts."""
    said = "refused"
    for _ in range(DRAWS):
        loaded: list[Scenario] = []
        fronts: list[hpop.Front] = []
        (folder / "room.yaml").write_text(as_yaml(allowed.scenario(rng, folder)))
        message = asked(lambda: loaded.append(load_scenario(folder / "room.yaml")))  # noqa: B023
        if not message:
            with _in_time_and_memory(loaded[0].planners):
                message = asked(lambda: fronts.append(loaded[0].problem.solve(list(loaded[0].planners))))  # noqa: B023
        if not message:
            break
        said = shown(message)
    else:
        return said
    problem, front = loaded[0].problem, fronts[0]
    _is_right(problem, front)
    for door in (_exact, _resumed, _driven, _on_disk, _on_the_command_line):
        if rng.random() < DOOR:
            door(rng, folder, loaded[0], front)
    return "accepted"


def _is_right(problem: hpop.Problem, front: hpop.Front) -> None:
    """Raise Wrong where a front is not what it claims."""
    if "NOT VALID" in front.certificate:
        raise Wrong("planned and re-evaluated costs differ")
    if faults := verify(problem, front):
        raise Wrong(f"verify: {_words(faults[0])}")
    if front.status == Status.NO_PATH and len(front):
        raise Wrong("no path, and points")
    repr(front), front.named()


def _words(fault: str) -> str:
    """Return a fault without its numbers, so that equal kinds are counted together."""
    return "".join("#" if letter.isdigit() else letter for letter in fault)[:100]


class _in_time_and_memory:  # noqa: N801  (read as a statement)
    """A block that may take some limits of time, by the processor, and of memory."""

    def __init__(self, planners: Any) -> None:
        limits = [getattr(planner, "time_limit", None) for planner in planners]
        self.seconds = None if None in limits else sum(limits)
        most = [getattr(planner, "max_memory", None) for planner in planners]
        self.bytes = None if None in most else max(most)

    def __enter__(self) -> None:
        self.began, self.compiled, self.peak = time.process_time(), compiled.compiling_seconds(), _peak(reset=True)

    def __exit__(self, kind: Any, *rest: Any) -> None:
        if kind is not None:
            return
        spent = time.process_time() - self.began - (compiled.compiling_seconds() - self.compiled)
        if self.seconds is not None and spent > TIMES * self.seconds + SLACK:
            raise Wrong("over three times its time limit")
        if self.bytes is not None and _peak() - self.peak > 1.5 * self.bytes + ROOM:
            raise Wrong("memory beyond max_memory")


def _peak(*, reset: bool = False) -> int:
    """Most memory of this process, bytes, since it was reset, or now where it is."""
    if reset:
        with suppress(OSError):  # not in every container: then peaks before count too, and less is found
            Path("/proc/self/clear_refs").write_text("5")
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


def _exact(rng: Rng, folder: Path, scenario: Scenario, front: hpop.Front) -> None:
    """Compare the claim of an exact planner with a search in plain loops on its graph."""
    problem = scenario.problem
    for planner in scenario.planners:
        query = planner.graph_of_drives
        options = {name: getattr(planner, name, None) for name in ("max_turns", "max_detour", "tolerance")}
        if query is None or any(value is not None for value in options.values()) or getattr(planner, "eps", 0.0):
            continue
        if any(person.moves for person in problem.world.content.people) or not _in_plane(problem):
            continue
        found: list[Any] = []
        unlimited = {name: None for name in (*COUNTED, "checkpoint") if hasattr(planner, name)}
        free = make_planner({planner.name: _options(planner) | unlimited})
        refused = asked(lambda: found.append(free.solve(problem)))  # noqa: B023
        if refused or found[0].status is not Status.COMPLETE:
            continue
        objectives = edge_objectives(problem.criteria, planner.name)
        asked_of = free.graph_of_drives.query(problem.keeping(free.margin), objectives)
        space, graph = asked_of.space, asked_of.graph
        if not space.is_checked:
            continue
        expected = _by_loops(graph, asked_of.start, asked_of.goals)
        if expected is None:
            continue
        own = {
            tuple(np.rint(row).astype(int).tolist())
            for row in pareto_paths(graph, asked_of.start, asked_of.goals).costs
        }
        if own != expected:
            raise Wrong(f"the exact search of {planner.name} differs from plain loops")
        quanta = np.array([criterion.quantum for criterion in objectives.optimised])
        planned = {tuple(row) for row in np.rint(found[0].planned / quanta).astype(int).tolist()}
        if not planned >= expected and not found[0].filters and "dropped" not in found[0].certificate:
            raise Wrong(f"{planner.name} lacks points of its graph")


def _in_plane(problem: hpop.Problem) -> bool:
    """Check that the problem's graph is one of positions and headings, which is built quickly."""
    return not {"arm", "joints"} & problem.model.provides or len(problem.start) == 5


def _options(planner: Any) -> dict[str, Any]:
    return {field.name: getattr(planner, field.name) for field in dataclasses.fields(planner) if field.init}


def _by_loops(graph: Graph, start: int, goals: list[int]) -> set[tuple[int, ...]] | None:
    """Costs of all non-dominated paths, label by label; None where that takes too many steps."""
    worst = [aggregate == "max" for aggregate in graph.aggregates]
    indptr, heads, costs = graph.indptr.tolist(), graph.heads.tolist(), graph.costs.tolist()
    kept: dict[int, list[tuple[int, ...]]] = {start: [(0,) * len(worst)]}
    queue = [((0,) * len(worst), start)]
    targets, steps = set(goals), 0
    while queue:
        label, node = heapq.heappop(queue)
        if label not in kept[node] or node in targets:
            continue
        for arc in range(indptr[node], indptr[node + 1]):
            steps += 1
            if steps > MOST_STEPS:
                return None
            paid = costs[arc]
            to = tuple(max(a, b) if w else a + b for a, b, w in zip(label, paid, worst, strict=True))
            there = kept.setdefault(heads[arc], [])
            if any(all(a <= b for a, b in zip(other, to, strict=True)) for other in there):
                continue
            there[:] = [o for o in there if not all(a <= b for a, b in zip(to, o, strict=True))]
            there.append(to)
            heapq.heappush(queue, (to, heads[arc]))
    ends = {label for goal in goals for label in kept.get(goal, ())}
    return {a for a in ends if not any(b != a and all(x <= y for x, y in zip(b, a, strict=True)) for b in ends)}


def _resumed(rng: Rng, folder: Path, scenario: Scenario, front: hpop.Front) -> None:
    """Check that a search resumed from its checkpoint ends with the front of an uninterrupted search."""
    for number, planner in enumerate(scenario.planners):
        if not hasattr(planner, "checkpoint") or not (_in_plane(scenario.problem) or rng.random() < 0.1):
            continue
        unlimited = _options(planner) | dict.fromkeys((*COUNTED, "checkpoint"))
        at_once: list[hpop.Front] = []
        plan = lambda options: scenario.problem.solve({planner.name: options})  # noqa: E731, B023
        if asked(lambda: at_once.append(plan(unlimited | {"max_labels": 3000}))):  # noqa: B023
            continue
        if at_once[0].status != Status.COMPLETE:
            continue
        path = folder / f"resumed{number}"
        begun = unlimited | {"checkpoint": str(path), "max_labels": int(rng.integers(1, 200))}
        first = plan(begun)
        _is_right(scenario.problem, first)
        last = plan(unlimited | {"checkpoint": str(path)})
        _is_right(scenario.problem, last)
        if last.status != Status.COMPLETE or not np.array_equal(
            np.unique(last.integers, axis=0), np.unique(at_once[0].integers, axis=0)
        ):
            raise Wrong(f"a resumed {planner.name} finds another front")


def _driven(rng: Rng, folder: Path, scenario: Scenario, front: hpop.Front) -> None:
    """Drive a point of the front with events on the way, and replay its record."""
    if not len(front):
        return
    problem, now = scenario.problem, 0.0
    with_planner = None if rng.random() < 0.7 else {"lattice": {"step": 0.5}}
    drives: list[Any] = []
    if asked(lambda: drives.append(hpop.follow(problem, front, int(rng.integers(len(front))), planner=with_planner))):
        return
    (drive,) = drives

    def happens() -> None:
        nonlocal now
        now += float(rng.uniform(0, 1.5))
        kind = rng.integers(6)
        if kind == 0:
            found = drive.options(now, deadline=float(rng.choice([0.0, 0.1, 1.0])))
            if len(found) and rng.random() < 0.7:
                drive.take(int(rng.integers(len(found))))
        elif kind == 1:
            x, y = rng.uniform(0.5, 4.0), rng.uniform(0, 2.5)
            drive.world(now, close=shapely.box(x, y, x + 0.4, y + 0.6), name="wet")
        elif kind == 2:
            drive.world(now, open="wet")
        elif kind == 3:
            walker = hpop.Person(*rng.uniform(0.5, 2.5, 2), velocity=tuple(rng.uniform(-1, 1, 2)))
            drive.world(now, people=[walker] if rng.random() < 0.8 else [])
        elif kind == 4:
            drive.at(now)
        else:
            drive.wish(**{str(rng.choice(front.names)): -0.1})

    for _ in range(int(rng.integers(1, 6))):
        asked(happens)
    drive.save(folder / "drive.json")
    if message := asked(lambda: hpop.drive.load(folder / "drive.json")):
        raise Wrong(f"a drive that cannot be told again: {_words(message)}")


def _on_disk(rng: Rng, folder: Path, scenario: Scenario, front: hpop.Front) -> None:
    """Check that a front survives saving, loading, joining with itself and further evaluation."""
    path = folder / "saved.json"
    front.save(path)
    again = hpop.Front.load(path)
    if not np.array_equal(again.costs, front.costs) or len(again.trajectories) != len(front.trajectories):
        raise Wrong("a loaded front is another one")
    problem = hpop.Problem.from_description(again.problem or {})
    _is_right(problem, again)
    if plain(problem.describe()) != plain(scenario.problem.describe()):
        raise Wrong("a loaded problem is another one")
    both = front | again
    if not np.array_equal(np.unique(both.integers, axis=0), np.unique(front.integers, axis=0)):
        raise Wrong("a front joined with itself is another one")
    if asked(lambda: problem.evaluate(again, also=["rotation"])):
        return
    if rng.random() < 0.2:
        front._repr_html_(), problem._repr_html_()
    for trajectory in front.trajectories[:3]:
        problem.evaluate(trajectory)
        problem.trace(trajectory)


def _on_the_command_line(rng: Rng, folder: Path, scenario: Scenario, front: hpop.Front) -> None:
    """Run the commands that read the output of `hpop plan`."""
    draws = rng.random() < 0.3
    with nullcontext() if draws else patch("hpop.cli.results.draw", return_value=[]):
        command(["plan", "room.yaml", "--out", "out", *(["--verbose"] if draws else [])])
    if not (folder / "out/front.json").exists():
        return
    for words in _asked_of_a_folder(rng):
        if rng.random() < 0.4:
            command(words)


def _asked_of_a_folder(rng: Rng) -> Iterator[list[str]]:
    yield ["show", "out"]
    yield ["pick", "out", "--knee", "--csv", "camera.csv"]
    yield ["export", "out", "--format", str(rng.choice(["csv", "tum", "euroc", "nav2", "json", "glb", "unity-csv"]))]
    yield ["ride", "out", "--out", "ride.html"]
    (Path("events.yaml")).write_text("events: [{at: 0.5, options: true}, {at: 1, stop: 0.5}]\n")
    yield ["drive", "out", "--events", "events.yaml"]
