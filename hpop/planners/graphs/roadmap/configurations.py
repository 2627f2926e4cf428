"""Roadmap of configurations: random states of any robot model, and the chains of motions that connect them.

This is the probabilistic roadmap of Kavraki et al. 1996 (doi 10.1109/70.508439), in the space of the model's states and
with the metric of that space. An arc is the whole chain of motions by which the model connects two states, so the
roadmap does not depend on how the robot moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
from hpop.planners.graphs.roadmap.links import START, guided_samples, links_between, uniform_samples
from hpop.planners.graphs.roadmap.survey import GOAL_STATES, Survey, concatenated_states, guide_links
from hpop.planners.graphs.tour_stops import drawn_states
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph, aggregates
from hpop.planners.spending import Spending
from hpop.search import Graph

ARC = 16  # bytes of memory for an arc, without its costs
ORDERED = 40  # additional bytes for each arc while arcs are sorted
PIECES = 64  # work of checking a chain, as a multiple of the work for one motion
WORKED = 60_000  # largest number of bytes needed for computing the costs of a chain
COSTED = 2, 8  # least and largest work of computing a chain's costs, as a multiple of the work for one motion
SHARED = 8  # number of blocks into which the costs are divided at least, so that every core has some
NEAREST, FAR = 8, 8  # default numbers of neighbours and far links, for robots that do not move in the plane


@dataclass(frozen=True, eq=False)
class ConfigurationRoadmap(TrajectoryGraph):
    """Roadmap whose nodes are configurations of a robot, and whose arcs are chains of motions between them.

    Two linked nodes have an arc only if the model can connect them.

    nodes   (P,)    states: the start, the samples, the goals, and states on their straight approaches; NaN in
                    coordinates of a goal that may have any value
    links   (L, 2)  pairs of nodes, first and last, between which chains are tried, sorted by first node
    goals   node numbers of the goals
    name    description of the roadmap, for certificates
    chosen  options, JSON-able
    lazy    whether chains are checked for collisions only when a path uses them
    notes   remarks for the user
    """

    has_chains = True

    nodes: States
    links: IntArray
    goals: list[int]
    name: str
    chosen: dict[str, Any]
    lazy: bool = False
    notes: tuple[str, ...] = ()

    @property
    def is_checked(self) -> bool:
        """True if all arcs are known to be free of collisions."""
        return not self.lazy

    def with_checked_arcs(self) -> ConfigurationRoadmap:
        """Return this roadmap as one that omits chains in collision, once its arcs are first needed."""
        return replace(self, lazy=False) if self.lazy else self

    @property
    def start(self) -> int:
        """Node number of the start."""
        return START

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.nodes.size

    @property
    def words(self) -> str:
        """Description of the roadmap, for certificates."""
        return self.name

    @property
    def options(self) -> dict[str, Any]:
        """Options from which the roadmap was built, JSON-able."""
        return self.chosen

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of configurations and chains, for statistics."""
        return {"configurations": self.size, "chains": self.arcs.heads.size}

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions in the chains by which the model connects states."""
        start = self.nodes.take(slice(START, START + 1))
        return tuple(dict.fromkeys(leg.kind for leg in self.model.connect(start, start)))

    def states(self, ids: IntArray) -> States:
        """Return the configurations (N,) of some nodes."""
        return self.nodes.take(ids)

    def chains(self, tails: IntArray, heads: IntArray) -> MotionChains:
        """Return the chains (N,) from nodes ``tails`` to ``heads``, not checked for collisions."""
        return MotionChains.connecting(self, tails, heads, self.states(tails), self.states(heads))

    @cached_property
    def arcs(self) -> Arcs:
        """All arcs: chains that end at their head node and, unless the roadmap is lazy, are free of collisions."""
        free = np.zeros(len(self.links), dtype=np.bool_)

        def checked(part: slice) -> tuple[slice, BoolArray]:
            tails, heads = self.links[part].T
            chains = self.chains(tails, heads)
            reach = chains.reach(self.states(heads))
            return part, reach if self.lazy else reach & chains.free()

        for part, is_free in self.spending.each(checked, blocks(free.size, PIECES), f"{self.words} was built"):
            free[part] = is_free
        tails, heads = self.links[free].T
        return Arcs.sorted(self.size, [(tails, heads)])

    @property
    def rows(self) -> IntArray:
        """Row pointers (n + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1."""
        return self.arcs.start

    @property
    def heads(self) -> NDArray[np.int32]:
        """Node (m,) to which each arc leads."""
        return self.arcs.heads

    def arcs_free(self, arcs: IntArray) -> BoolArray:
        """Check some arcs (N,), given by index; return a mask, True for those that are free of collisions."""
        tails = np.searchsorted(self.arcs.start, arcs, side="right") - 1
        heads = self.arcs.heads[arcs].astype(np.int64)

        def are_free(part: slice) -> BoolArray:
            return self.chains(tails[part], heads[part]).free()

        parts = Spending().each(are_free, blocks(arcs.size, PIECES), "chains of motions were checked")
        return np.concatenate([np.zeros(0, np.bool_), *parts])

    def without(self, arcs: IntArray) -> ConfigurationRoadmap:
        """Return the roadmap without some arcs (N,), given by index."""
        links = np.stack(self.arcs.ends(slice(0, self.arcs.heads.size)), axis=1)
        return replace(self, links=np.delete(links, arcs, axis=0))

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Compute the costs of all chains and return the graph for a search, with one integer cost for each criterion.

        A cost is a number of the criterion's quanta, rounded up once for the whole chain.
        """
        arcs = self.arcs
        costs = self.chain_costs(*arcs.ends(slice(0, arcs.heads.size)), criteria, self.chains)
        costs.setflags(write=False)
        return Graph.from_csr(arcs.start, arcs.heads, costs, aggregates=aggregates(criteria))

    def chain_costs(
        self,
        tails: IntArray,
        heads: IntArray,
        criteria: Sequence[Criterion],
        chains: Callable[..., MotionChains],
        *classes: IntArray,
    ) -> IntArray:
        """Return the costs (N, k) of chains between nodes, in quanta, rounded up once for each chain.

        tails, heads  (N,)  first and last nodes
        chains        function of tails, heads and ``classes`` that returns the chains
        classes       further arguments (N,) of ``chains``
        """
        size, doing = tails.size, f"{self.words} was built"
        self.spending.check(doing, size * (8 * len(criteria) + ARC + ORDERED))
        self.spending.hold(size * (8 * len(criteria) + ARC), doing)
        costs = np.empty((size, len(criteria)), np.int64)
        there_and_back = np.lexsort((np.maximum(tails, heads), np.minimum(tails, heads)))

        def paid(part: slice) -> tuple[IntArray, IntArray]:
            rows = there_and_back[part]
            return rows, chains(tails[rows], heads[rows], *(each[rows] for each in classes)).costs(criteria)

        each = int(np.clip(SHARED * BLOCK // max(1, size), *COSTED))
        if (most := self.spending.limits.max_memory) is not None:  # smaller blocks: all cores share the memory
            each = max(each, int(WORKED * BLOCK * self.spending.cores // max(1, most)))
        for rows, counts in self.spending.each(paid, blocks(size, each), doing):
            costs[rows] = counts
        return costs

    @cached_property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of motions in each arc; among paths of equal costs, searches prefer fewer motions."""
        size = self.arcs.heads.size
        parts = [self.chains(*self.arcs.ends(part)).count(self.kinds) for part in blocks(size, PIECES)]
        return np.concatenate([np.zeros(0, np.int8), *parts]).astype(np.int8)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, with all motions of the chains.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        alone = sizes == 1  # a path of one node becomes a chain without motions from the node to itself
        ids = np.repeat(ids, np.repeat(np.where(alone, 2, 1), sizes))
        sizes = sizes + alone
        heads = np.delete(np.arange(ids.size), np.cumsum(sizes) - sizes)
        return self.chains(ids[heads - 1], ids[heads]).stretches(sizes - 1)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text, why no path leads from the start to the goals.

        It gives the sizes of the unconnected parts of the roadmap or, if arcs are checked on demand, the number of
        configurations that can be reached from the start by arcs that are not known to collide.
        """
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order, connected_components

        arcs = self.arcs
        links = csr_array((np.ones(arcs.heads.size), arcs.heads, arcs.start), shape=(self.size, self.size))
        if self.lazy:  # arcs near the goal have not been checked, so only the part of the start is known
            reached = breadth_first_order(links, start, return_predecessors=False).size
            return (
                f"no path: on {self.words}, at most {reached} of {self.size} configurations can be reached from the "
                "start without a collision, but no goal; take more samples"
            )
        components, component = connected_components(links, directed=False)
        begin, *ends = component[[start, *goals]].tolist()
        if begin in ends:
            return (
                f"no path: {self.words} connects start and goal only by motions in the opposite direction; take more "
                "samples"
            )
        sizes = np.bincount(component)
        apart = ", ".join(str(sizes[end]) for end in dict.fromkeys(ends))
        return (
            f"no path: {self.words} has {components} unconnected parts; the part with the start has {sizes[begin]} of "
            f"{self.size} configurations, the part with the goal {apart}; take more samples"
        )


def configuration_roadmap(
    ends_and_guides: Survey,
    samples: int,
    neighbours: int | None,
    far: int | None,
    spending: Spending,
    views: States | None = None,
) -> ConfigurationRoadmap:
    """Draw configurations, link them and return the roadmap between the start and goals of a survey.

    Unless the robot moves in the plane, chains are checked for collisions only on demand. Raises OptionError if there
    are more links than a graph can have.

    Parameters
    ----------
    samples : number of collision-free configurations to draw; fewer are used if nearly all that are drawn collide
    neighbours : number of nearest nodes to which each node is linked; None: ceil(2e log n) for n nodes in the plane,
        else 8
    far : number of nodes farther away to which each node is linked; None: none in the plane, else 8
    views : further nodes, free states in which the camera looks at something
    """
    problem, connections, seed = ends_and_guides.problem, ends_and_guides.connections, ends_and_guides.seed
    model, space, in_plane = problem.model, connections.space, "plane" in problem.model.provides
    _, of_samples, _, of_links = np.random.default_rng(seed).spawn(4)
    start, goals, found, pairs = (
        ends_and_guides.start,
        ends_and_guides.goals,
        ends_and_guides.guides,
        ends_and_guides.pairs,
    )
    if found and length(found[0], connections) > 0.0:  # otherwise the start is at a goal already
        rows = guided_samples(connections, *ends_and_guides.ends, found, samples, of_samples, spending)
    else:
        rows = uniform_samples(connections, samples, of_samples, spending)
    tour = problem.tour
    stops = [] if tour is None else [tour.stops[i] for i in tour.remaining]
    at_stops = [connections.rows(drawn_states(problem, stop)) for stop in stops]
    seeing = [connections.rows(views)] if views is not None else []
    free = connections.states(np.concatenate([ends_and_guides.inner, *at_stops, rows, *seeing]))
    nodes = concatenated_states(space, [start, free, goals, connections.states(ends_and_guides.following)])
    near = neighbours or (math.ceil(2 * math.e * math.log(nodes.size)) if in_plane else NEAREST)
    nearest_in_random_subsets = (0 if in_plane else FAR) if far is None else far
    name = f"the roadmap of {len(rows)} samples (seed {seed}) and {near} neighbours of each"
    chosen: dict[str, Any] = {"samples": len(rows), "neighbours": near, "seed": seed}
    if views is not None:
        chosen = {**chosen, "samples": len(rows) + views.size, "views": views.size}
    if nearest_in_random_subsets:
        name = f"{name.removesuffix(' of each')} and {nearest_in_random_subsets} far links of each"
        chosen = {**chosen, "far": nearest_in_random_subsets}
    if views is not None:
        name += f", {views.size} views"
    if at_stops:
        name += f", {sum(map(len, at_stops))} states of stops"
    if pairs:
        name += f", {_guides_text(len(found), len(ends_and_guides.inner))}"
        chosen = {**chosen, "trees": pairs}
    if not problem.target.listed:
        name += f", {goals.size} free states of the goal ({ends_and_guides.goal_count} found, {GOAL_STATES} sought)"
        chosen = {**chosen, "goal_states": goals.size, "goal_states_found": ends_and_guides.goal_count}
    name += _constraints_text(ends_and_guides)
    links = links_between(
        space,
        start,
        free,
        goals,
        count=near,
        far=nearest_in_random_subsets,
        chosen=guide_links(found, ends_and_guides.goal_nodes(free.size)),
        rng=of_links,
        spending=spending,
    )
    return ConfigurationRoadmap(
        model,
        problem.world,
        nodes,
        np.concatenate([links, ends_and_guides.approach_links(free.size)]),
        ends_and_guides.target_nodes(free.size),
        name=name,
        chosen=chosen,
        lazy=not in_plane,
        notes=(f"{pairs} pairs of random trees found no path near which to draw samples: samples are uniform",)
        if pairs and not found
        else (),
        spending=spending,
    )


def guide_roadmap(ends_and_guides: Survey, spending: Spending) -> ConfigurationRoadmap:
    """Build the roadmap of the guides (first paths found by random trees) alone, without samples.

    It can be searched quickly, and every roadmap with samples contains it.
    """
    free, connections = len(ends_and_guides.inner), ends_and_guides.connections
    inner, following = (connections.states(rows) for rows in (ends_and_guides.inner, ends_and_guides.following))
    links = guide_links(ends_and_guides.guides, ends_and_guides.goal_nodes(free))
    return ConfigurationRoadmap(
        ends_and_guides.problem.model,
        ends_and_guides.problem.world,
        concatenated_states(connections.space, [ends_and_guides.start, inner, ends_and_guides.goals, following]),
        np.concatenate([links, ends_and_guides.approach_links(free)]),
        ends_and_guides.target_nodes(free),
        name=f"{_guides_text(len(ends_and_guides.guides), free)} (seed {ends_and_guides.seed})"
        + _constraints_text(ends_and_guides),
        chosen={"trees": ends_and_guides.pairs, "seed": ends_and_guides.seed},
        spending=spending,
    )


def _guides_text(count: int, states: int) -> str:
    """Return the number of guides, and of states on them between start and goals, as text for certificates."""
    through = f"through {states} states" if states else "straight to a goal"
    return f"{count} guides (paths that random trees found) {through}"


def _constraints_text(ends_and_guides: Survey) -> str:
    """Return the constraint of all motions of a roadmap, and how goals are approached, as text for certificates."""
    kept = ends_and_guides.connections.collision.constraint
    lines = {str(goal.straight) for goal in ends_and_guides.problem.target.alternatives() if goal.straight is not None}
    texts = [f"on which {kept}"] * bool(kept)
    return "".join(f", {text}" for text in (*texts, *(f"which reaches its goals {line}" for line in sorted(lines))))
