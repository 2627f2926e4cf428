"""A roadmap of configurations: states of any model, drawn at random, and the chains of motions that connect them.

A roadmap of Kavraki et al. 1996 (doi 10.1109/70.508439) in the space of the model's states, by its metric. An arc is
the whole chain by which the model connects two states, so the roadmap works for any laws of motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.criteria.base import Criterion
from hpop.motions import States
from hpop.planners.graphs.arcs import BLOCK, Arcs, MotionChains, blocks
from hpop.planners.graphs.roadmap.guides import length
from hpop.planners.graphs.roadmap.links import START, guided, linked, uniform
from hpop.planners.graphs.roadmap.survey import GOAL_STATES, Survey, all_of, along
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph, aggregates
from hpop.planners.spending import Spending
from hpop.search import Graph

ARC = 16  # bytes of an arc without its costs
ORDERED = 40  # bytes of an arc while arcs are ordered
PIECES = 64  # work of checking a chain, in arcs of one motion
WORKED = 60_000  # bytes for costing a chain, at most
COSTED = 2, 8  # work of costing a chain, in arcs; small roadmaps have larger blocks
SHARED = 8  # least number of blocks of costs, so that every core has some
NEAREST, FAR = 8, 8  # neighbours and far links of robots beyond the plane


@dataclass(frozen=True, eq=False)
class ConfigurationRoadmap(TrajectoryGraph):
    """Configurations of a robot, and the free chains of motions between them.

    nodes   (P,)    the start, the samples, the goals; NaN in free coordinates of a goal
    links   (L, 2)  tails and heads, by tail, of possible chains
    goals   nodes
    name    description in words
    chosen  options, as JSON
    lazy    whether chains are checked for collisions only where a path takes them
    notes   for the user

    There is no arc between states that the model does not connect.
    """

    nodes: States
    links: IntArray
    goals: list[int]
    name: str
    chosen: dict[str, Any]
    lazy: bool = False
    notes: tuple[str, ...] = ()

    @property
    def is_checked(self) -> bool:
        """True if all arcs are known to be free."""
        return not self.lazy

    def with_checked_arcs(self) -> ConfigurationRoadmap:
        """Return the same roadmap with every chain checked when it is built."""
        return replace(self, lazy=False) if self.lazy else self

    @property
    def start(self) -> int:
        """The node of the start."""
        return START

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.nodes.size

    @property
    def words(self) -> str:
        """Description of the roadmap in words."""
        return self.name

    @property
    def options(self) -> dict[str, Any]:
        """Options of the roadmap, as JSON."""
        return self.chosen

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of configurations and chains."""
        return {"configurations": self.size, "chains": self.arcs.heads.size}

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the legs by which the model connects states."""
        start = self.nodes.take(slice(START, START + 1))
        return tuple(dict.fromkeys(leg.kind for leg in self.model.connect(start, start)))

    def states(self, ids: IntArray) -> States:
        """Return configurations (N,) by their nodes."""
        return self.nodes.take(ids)

    def _chains(self, tails: IntArray, heads: IntArray) -> MotionChains:
        """Return the chains (N,) between nodes, free or not."""
        return MotionChains.connecting(self, tails, heads, self.states(tails), self.states(heads))

    @cached_property
    def arcs(self) -> Arcs:
        """All chains that reach their heads, each an arc; only free ones unless they are checked later."""
        free = np.zeros(len(self.links), dtype=np.bool_)

        def checked(part: slice) -> tuple[slice, BoolArray]:
            tails, heads = self.links[part].T
            chains = self._chains(tails, heads)
            reach = chains.reach(self.states(heads))
            return part, reach if self.lazy else reach & chains.free()

        for part, is_free in self.spending.each(checked, blocks(free.size, PIECES), f"{self.words} was laid out"):
            free[part] = is_free
        tails, heads = self.links[free].T
        return Arcs.sorted(self.size, [(tails, heads)])

    def arcs_free(self, places: IntArray) -> BoolArray:
        """Mark the free ones of some arcs (N,), given by their indices."""
        tails = np.searchsorted(self.arcs.start, places, side="right") - 1
        heads = self.arcs.heads[places].astype(np.int64)

        def looked_at(part: slice) -> BoolArray:
            return self._chains(tails[part], heads[part]).free()

        parts = Spending().each(looked_at, blocks(places.size, PIECES), "chains were looked at")
        return np.concatenate([np.zeros(0, np.bool_), *parts])

    def without(self, places: IntArray) -> ConfigurationRoadmap:
        """Return the roadmap without some arcs (N,)."""
        links = np.stack(self.arcs.ends(slice(0, self.arcs.heads.size)), axis=1)
        return replace(self, links=np.delete(links, places, axis=0))

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the graph with one integer cost a criterion: costs of chains in quanta, rounded once."""
        arcs, doing = self.arcs, f"{self.words} was built"
        size = arcs.heads.size
        self.spending.check(doing, size * (8 * len(criteria) + ARC + ORDERED))
        self.spending.hold(size * (8 * len(criteria) + ARC), doing)
        costs, (tails, heads) = np.empty((size, len(criteria)), np.int64), arcs.ends(slice(0, size))
        there_and_back = np.lexsort((np.maximum(tails, heads), np.minimum(tails, heads)))

        def paid(part: slice) -> tuple[IntArray, IntArray]:
            places = there_and_back[part]
            return places, self._chains(tails[places], heads[places]).costs(criteria)

        each = int(np.clip(SHARED * BLOCK // max(1, size), *COSTED))
        if (most := self.spending.limits.max_memory) is not None:  # a limit for all cores together
            each = max(each, int(WORKED * BLOCK * self.spending.cores // max(1, most)))
        for places, counts in self.spending.each(paid, blocks(size, each), doing):
            costs[places] = counts
        costs.setflags(write=False)
        return Graph.from_csr(arcs.start, arcs.heads, costs, aggregates=aggregates(criteria))

    @cached_property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of motions in each arc."""
        size = self.arcs.heads.size
        parts = [self._chains(*self.arcs.ends(part)).count(self.kinds) for part in blocks(size, PIECES)]
        return np.concatenate([np.zeros(0, np.int8), *parts]).astype(np.int8)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return trajectories through nodes (N,), ``sizes`` (n,) of them for each, with the motions of chains."""
        alone = sizes == 1  # from a node to itself: a chain without motions
        ids = np.repeat(ids, np.repeat(np.where(alone, 2, 1), sizes))
        sizes = sizes + alone
        heads = np.delete(np.arange(ids.size), np.cumsum(sizes) - sizes)
        return self._chains(ids[heads - 1], ids[heads]).stretches(sizes - 1)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Say why no path leads from start to goals: the components with both, or the reached states."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order, connected_components

        arcs = self.arcs
        links = csr_array((np.ones(arcs.heads.size), arcs.heads, arcs.start), shape=(self.size, self.size))
        if self.lazy:  # arcs on the goal's side have not been checked
            reached = breadth_first_order(links, start, return_predecessors=False).size
            return (
                f"no path: on {self.words} {reached} of {self.size} configurations, and no goal, are reached from the "
                "start by edges that are not blocked; take more samples"
            )
        components, component = connected_components(links, directed=False)
        begin, *ends = component[[start, *goals]].tolist()
        if begin in ends:
            return (
                f"no path: start and goal are in one component of {self.words}, but its motions lead the other way; "
                "take more samples"
            )
        sizes = np.bincount(component)
        apart = ", ".join(str(sizes[end]) for end in dict.fromkeys(ends))
        return (
            f"no path: {self.words} has {components} components; that of the start has {sizes[begin]} of {self.size} "
            f"configurations, that of the goal {apart}; take more samples"
        )


def configuration_roadmap(
    known: Survey, samples: int, neighbours: int | None, far: int | None, spending: Spending
) -> ConfigurationRoadmap:
    """Return the roadmap between the start and goals of a survey; lazy unless the robot moves in the plane.

    Raises OptionError for more links than a graph can have.

    Parameters
    ----------
    samples : number of free configurations to draw; fewer where hardly any are free
    neighbours : number of nearest nodes to which each is linked; None: ceil(2e log n) for n nodes in the plane, else 8
    far : number of nodes farther away to which each is linked; None: none in the plane, else 8
    """
    problem, connections, seed = known.problem, known.connections, known.seed
    model, space, in_plane = problem.model, connections.space, "plane" in problem.model.provides
    _, of_samples, _, of_links = np.random.default_rng(seed).spawn(4)
    start, goals, found, pairs = known.start, known.goals, known.guides, known.pairs
    if found and length(found[0], connections) > 0.0:  # else the start is at a goal
        rows = guided(connections, *known.ends, found, samples, of_samples, spending)
    else:
        rows = uniform(connections, samples, of_samples, spending)
    free = connections.states(np.concatenate([known.inner, rows]))
    nodes = all_of(space, [start, free, goals])
    near = neighbours or (math.ceil(2 * math.e * math.log(nodes.size)) if in_plane else NEAREST)
    farther = (0 if in_plane else FAR) if far is None else far
    name = f"the roadmap of {len(rows)} samples (seed {seed}) and {near} neighbours of each"
    chosen: dict[str, Any] = {"samples": len(rows), "neighbours": near, "seed": seed}
    if farther:
        name, chosen = f"{name}, {farther} far links", {**chosen, "far": farther}
    if pairs:
        name, chosen = f"{name}, {len(found)} guides of {len(known.inner)} states", {**chosen, "trees": pairs}
    if not problem.target.listed:
        name += f", {goals.size} free states of the goal ({known.sought} found, {GOAL_STATES} sought)"
        chosen = {**chosen, "goal_states": goals.size, "goal_states_found": known.sought}
    return ConfigurationRoadmap(
        model,
        problem.world,
        nodes,
        linked(
            space,
            start,
            free,
            goals,
            count=near,
            far=farther,
            chosen=along(found, known.places(free.size)),
            rng=of_links,
            spending=spending,
        ),
        known.targets(free.size),
        name=name,
        chosen=chosen,
        lazy=not in_plane,
        notes=(f"{pairs} pairs of trees found no guide: samples are uniform",) if pairs and not found else (),
        spending=spending,
    )


def guide_roadmap(known: Survey, spending: Spending) -> ConfigurationRoadmap:
    """Return the roadmap of the guides alone, a part of every roadmap with samples."""
    free = len(known.inner)
    return ConfigurationRoadmap(
        known.problem.model,
        known.problem.world,
        all_of(known.connections.space, [known.start, known.connections.states(known.inner), known.goals]),
        along(known.guides, known.places(free)),
        known.targets(free),
        name=f"{len(known.guides)} guides of {free} states (seed {known.seed})",
        chosen={"trees": known.pairs, "seed": known.seed},
        spending=spending,
    )
