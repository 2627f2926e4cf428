"""Claims: of any networkx graph the front is that of all its simple paths, in its own names, units and edges."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
import pytest

from hpop.errors import GraphError, OptionError, QueryError
from hpop.frontier import ItemFront, is_nondominated
from hpop.search import Graph, capped_mean_paths, pareto_paths, supported_paths

KINDS = [nx.Graph, nx.DiGraph, nx.MultiGraph, nx.MultiDiGraph]
COSTS = ["length", "risk", "step"]
AGGREGATES = ["sum", "sum", "max"]


def city(kind: type, seed: int, nodes: int = 7, edges: int = 14) -> nx.Graph:
    """Return a random graph with names and three costs: floats of two sizes, and small whole numbers."""
    rng = np.random.default_rng(seed)
    g = kind()
    names = [f"place {n}" for n in rng.permutation(nodes)]
    g.add_nodes_from(names)
    for _ in range(edges):
        tail, head = rng.choice(names, 2, replace=False).tolist()
        g.add_edge(tail, head, length=rng.uniform(1, 500), risk=rng.uniform(0, 1e-3), step=int(rng.integers(1, 5)))
    return g


def all_values(g: nx.Graph, source: object, target: object) -> np.ndarray:
    """Return the costs of every simple path, by networkx's own enumeration."""
    found = []
    for path in nx.all_simple_edge_paths(g, source, target):
        rows = np.array([[g.edges[edge][name] for name in COSTS] for edge in path])
        found.append([*rows[:, :2].sum(axis=0), rows[:, 2].max()])
    return np.array(found).reshape(-1, 3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.seeds(3, of=40)
def test_the_front_is_that_of_all_simple_paths(seed, kind):
    g = city(kind, seed)
    paths = pareto_paths(g, "place 0", "place 1", costs=COSTS, aggregates=AGGREGATES)
    every = all_values(g, "place 0", "place 1")
    expected = every[is_nondominated(every)] if len(every) else every
    np.testing.assert_allclose(np.sort(paths.values, axis=0), np.sort(expected, axis=0), rtol=1e-12)
    assert len(paths) == len(expected) == len(paths.front())


@pytest.mark.parametrize("kind", KINDS)
def test_paths_are_told_in_the_nodes_and_edges_of_the_graph(kind):
    g = city(kind, 3, edges=30)
    paths = pareto_paths(g, "place 0", "place 1", costs=COSTS, aggregates=AGGREGATES)
    assert len(paths) > 1
    for i in range(len(paths)):
        nodes, edges = paths.path(i), paths.edges(i)
        assert (nodes[0], nodes[-1]) == ("place 0", "place 1")
        assert nx.is_path(g, nodes)
        assert [edge[:2] for edge in edges] == list(itertools.pairwise(nodes))
        rows = np.array([[g.edges[edge][name] for name in COSTS] for edge in edges])
        np.testing.assert_allclose(paths.values[i], [*rows[:, :2].sum(axis=0), rows[:, 2].max()], rtol=1e-12)
        given = list(g.edges(keys=True) if g.is_multigraph() else g.edges())
        assert [set(given[arc][:2]) for arc in paths.arcs(i)] == [set(edge[:2]) for edge in edges]


@pytest.mark.parametrize("quanta", [{"length": 25.0, "risk": 1e-4}, [25.0, 1e-4, 1.0]])
def test_costs_are_rounded_up_to_quanta_edge_by_edge(quanta):
    g = city(nx.Graph, 5)
    graph = Graph.from_networkx(g, COSTS, quanta=quanta)
    for arc, costs in zip(graph.arc, graph.costs, strict=True):
        data = list(g.edges(data=True))[arc][2]
        assert costs.tolist() == [math.ceil(data["length"] / 25), math.ceil(data["risk"] / 1e-4), data["step"]]
    paths = pareto_paths(graph, "place 0", "place 1")
    counted = paths.costs * [25.0, 1e-4, 1.0]
    assert (counted >= paths.values).all()
    assert (counted < paths.values + paths.lengths[:, None] * [25.0, 1e-4, 1.0]).all()


def test_what_is_a_whole_number_of_quanta_but_for_rounding_stays_that_number():
    g = nx.path_graph(4, nx.DiGraph)
    nx.set_edge_attributes(g, dict(zip(g.edges, (0.1 + 0.2, 0.7, 0.1 * 3), strict=True)), "length")
    assert Graph.from_networkx(g, ["length"], quanta={"length": 0.1}).costs.ravel().tolist() == [3, 7, 3]


def test_a_quantum_that_is_not_given_is_one_for_whole_numbers_else_a_billionth_of_the_largest():
    g = nx.Graph(
        [("a", "b", {"turns": True, "length": 320.5, "hops": 3}), ("b", "c", {"turns": 0, "length": 1, "hops": 3.0})]
    )
    graph = Graph.from_networkx(g, ["turns", "length", "hops"])
    assert graph.edges.quanta.tolist() == [1.0, 1e-7, 1.0]
    assert pareto_paths(graph, "a", "c").costs.tolist() == [[1, 3_215_000_000, 6]]


def test_whole_numbers_beyond_what_a_float_holds_stay_exact():
    g = nx.Graph([("a", "b", {"n": 2**53}), ("b", "c", {"n": 1})])
    assert pareto_paths(g, "a", "c", costs="n").values.tolist() == [[2**53 + 1]]


def test_ends_are_names_also_where_these_are_numbers_or_tuples():
    g = nx.DiGraph()
    g.add_edge(2, 0, n=1)
    g.add_edge(0, 1, n=5)
    assert pareto_paths(g, 2, 1, costs=["n"]).path(0) == [2, 0, 1]
    grid = nx.grid_2d_graph(3, 3)
    nx.set_edge_attributes(grid, 1, "n")
    assert pareto_paths(grid, (0, 0), (1, 2), costs=["n"]).values.tolist() == [[3]]
    several = pareto_paths(grid, (0, 0), [(2, 2), (0, 1)], costs=["n"])
    assert (several.values.tolist(), several.path(0)) == ([[1]], [(0, 0), (0, 1)])
    assert pareto_paths(Graph.from_arcs(2, [0], [1], [[4]]), 0, 1).path(0) == [0, 1]


def test_a_graph_goes_back_to_networkx_as_it_came():
    for kind in (nx.DiGraph, nx.MultiDiGraph):
        g = city(kind, 1)
        back = Graph.from_networkx(g, COSTS).to_networkx()
        assert list(back.nodes) == list(g.nodes)
        edges = [
            sorted((u, v, *(data[name] for name in COSTS)) for u, v, data in h.edges(data=True)) for h in (g, back)
        ]
        assert edges[0] == edges[1]
    two_ways = Graph.from_networkx(city(nx.Graph, 1), COSTS).to_networkx()
    assert all(two_ways.has_edge(v, u, key) for u, v, key in two_ways.edges(keys=True))


def test_bounds_and_tolerances_go_by_name_in_units():
    g = city(nx.Graph, 3, nodes=9, edges=24)
    graph = Graph.from_networkx(g, COSTS, aggregates=AGGREGATES)
    everything = pareto_paths(graph, "place 0", "place 1")
    middle = float(np.median(everything.values[:, 0]))
    kept = everything.values[everything.values[:, 0] <= middle]
    within = pareto_paths(graph, "place 0", "place 1", at_most={"length": middle + 1e-5})
    assert within.values.tolist() == kept.tolist() != everything.values.tolist()
    assert f"of at most length {middle:.6g}"[:20] in within.front().certificate
    near = pareto_paths(graph, "place 0", "place 1", tolerance={"length": 300.0, "risk": 1e-3})
    assert len(near) < len(everything)
    for row in everything.values:
        assert (near.values <= row + [300.0, 1e-3, 0.0] + 1e-5).all(axis=1).any()
    assert "within a tolerance of length 300, risk 0.001" in near.front().certificate


def test_the_front_of_paths_holds_their_values_and_nodes_and_is_saved(tmp_path):
    paths = pareto_paths(city(nx.Graph, 3), "place 0", "place 1", costs=COSTS, aggregates=AGGREGATES)
    front = paths.front(units=["m", "1", "m"])
    assert isinstance(front, ItemFront)
    assert (front.names, front.units, front.status) == (tuple(COSTS), ("m", "1", "m"), "complete")
    assert front.certificate.startswith("all non-dominated vectors of paths, costs rounded up edge by edge to quanta")
    np.testing.assert_array_equal(np.sort(front.costs, axis=0), np.sort(paths.values, axis=0))
    shortest = min(range(len(paths)), key=lambda i: paths.values[i, 0])
    assert front.best("length").item == paths.path(shortest)
    front.save(tmp_path / "front.json")
    assert ItemFront.load(tmp_path / "front.json").items == front.items
    numbered = pareto_paths(Graph.from_arcs(2, [0], [1], [[4, 2]]), 0, 1).front()
    assert (numbered.names, numbered.items) == (("f1", "f2"), ([0, 1],))


def test_a_search_that_was_stopped_says_so_in_its_front():
    from hpop.runtime.limits import Budget

    g = city(nx.Graph, 2, nodes=30, edges=120)
    part = pareto_paths(g, "place 0", "place 1", costs=COSTS, budget=Budget(max_labels=4))
    assert part.front().certificate.startswith("not complete: some of all non-dominated vectors of paths")


def test_weighted_sums_and_means_take_names_as_well():
    g = city(nx.Graph, 3)
    graph = Graph.from_networkx(g, ["length", "step"])
    supported = supported_paths(graph, "place 0", "place 1")
    assert supported.front().certificate.startswith("supported vectors of paths")
    assert {tuple(row) for row in supported.values} <= {
        tuple(r) for r in pareto_paths(graph, "place 0", "place 1").values
    }
    means = capped_mean_paths(graph, "place 0", "place 1", integral=0, duration=1, cap=12)
    assert means.path(0)[0] == "place 0"
    with pytest.raises(OptionError, match=r"means.*items"):
        means.front()


def test_edges_that_turn_out_blocked_are_no_part_of_paths_in_names():
    g = city(nx.MultiGraph, 3)
    graph = Graph.from_networkx(g, COSTS, aggregates=AGGREGATES)
    one = pareto_paths(graph, "place 0", "place 1")
    gone = int(one.arcs(0)[0])
    left = pareto_paths(graph, "place 0", "place 1", free=lambda arcs: graph.arc[arcs] != gone)
    h = nx.MultiGraph(g)
    h.remove_edge(*list(g.edges(keys=True))[gone])
    every = all_values(h, "place 0", "place 1")
    np.testing.assert_allclose(np.sort(left.values, axis=0), np.sort(every[is_nondominated(every)], axis=0))


def test_no_path_is_a_result():
    g = nx.Graph([("a", "b", {"n": 1.5})])
    g.add_node("c")
    paths = pareto_paths(g, "a", "c", costs=["n"])
    assert (str(paths.status), paths.values.shape, len(paths.front())) == ("no path", (0, 1), 0)
    alone = nx.DiGraph()
    alone.add_nodes_from("ab")
    assert Graph.from_networkx(alone, ["n"]).arcs == 0


GOOD = nx.Graph([("a", "b", {"length": 1.5, "turns": 2}), ("b", "c", {"length": 0.5, "turns": 0})])


def with_cost(value: object) -> nx.Graph:
    g = GOOD.copy()
    g.edges["b", "c"]["length"] = value
    return g


@pytest.mark.parametrize(
    ("g", "options", "message"),
    [
        (GOOD, {"costs": ["lenght"]},
         r"2 of 2 edges have no attribute 'lenght', the first is edge 'a' - 'b'; edges have "
         r"'length', 'turns'. Did you mean 'length'\?"),
        (nx.Graph([("a", "b", {"n": 1}), ("b", "c")]), {"costs": ["n"]},
         "one edge has no attribute 'n', the first is edge 'b' - 'c'"),
        (GOOD, {}, "costs must name the attributes of edges.*got none; edges have 'length', 'turns'"),
        (GOOD, {"costs": ["turns", "turns"]}, "each once, .*got"),
        (GOOD, {"costs": [1]}, "costs must name the attributes"),
        (with_cost(-1.0), {"costs": ["length"]}, "at least 0, got -1.0 as 'length' of edge 'b' - 'c'; to maximise"),
        (with_cost(-1.0), {"costs": ["length"]}, r"also rewards fewer edges\), or -log\(p\) of a probability p$"),
        (with_cost(math.nan), {"costs": ["length"]},
         "finite numbers of at least 0, got nan as 'length' of edge 'b' - 'c'"),
        (with_cost(math.inf), {"costs": ["length"]}, "got inf as 'length'"),
        (with_cost("3"), {"costs": ["length"]}, "got '3' as 'length'"),
        (with_cost([3]), {"costs": ["length"]}, r"got \[3\] as 'length'"),
        (with_cost(1e300), {"costs": ["length"], "quanta": [1e-9]}, "with the quantum 1e-09"),
        (with_cost(2**70), {"costs": ["turns", "length"]}, None),
        (GOOD, {"costs": ["length"], "quanta": {"lengths": 1}},
         r"must name costs \(length\), got 'lengths'. Did you mean 'length'"),
        (GOOD, {"costs": ["length"], "quanta": {"length": 0}},
         "the quantum of 'length' must be a positive finite number, got 0"),
        (GOOD, {"costs": ["length"], "quanta": [1, 2]}, "quanta must have one number for each of length"),
        (GOOD, {"costs": ["length"], "quanta": 0.1}, "quanta must have one number for each of length"),
        (GOOD, {"costs": list("abcdefg")}, "no attribute 'a'"),
        ({"a": {"b": 1}}, {"costs": ["length"]}, "got {'a': {'b': 1}}; for arrays use Graph.from_arcs"),
        (np.eye(3), {"costs": ["length"]}, "must be a networkx graph, got an object of numpy.ndarray"),
        (None, {"costs": ["length"]}, "must be a networkx graph, got None"),
    ],
)  # fmt: skip
def test_what_is_no_graph_with_costs_is_refused_by_name(g, options, message):
    if message is None:  # large whole numbers among floats are rounded as those are
        assert len(pareto_paths(g, "a", "c", **options)) == 1
        return
    with pytest.raises(GraphError, match=message):
        pareto_paths(g, "a", "c", **options)


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        ("A", "c", "source: no node is called 'A'; the 3 nodes are called 'a', 'b', 'c'"),
        ("a", "d", "target: no node is called 'd'"),
        (0, "c", "source: no node is called 0"),
        (["a"], "c", r"source: no node is called \['a'\]"),
        ("a", ["c", "d"], "target: no node is called 'd'"),
        ("a", ("c", "d"), "target: no node is called 'd'"),
        ("a", (3, 4), r"target: no node is called \(3, 4\)"),
        ("a", [], "at least one node"),
        ("a", None, "target must be a node or several nodes, got None"),
    ],
)
def test_ends_that_are_not_there_are_told_with_those_that_are(source, target, message):
    with pytest.raises(QueryError, match=message):
        pareto_paths(GOOD, source, target, costs=["length"])


def test_options_that_do_not_fit_are_refused():
    graph = Graph.from_networkx(GOOD, ["length"])
    plain = Graph.from_arcs(2, [0], [1], [[1]])
    with pytest.raises(OptionError, match="only for networkx graphs"):
        pareto_paths(graph, "a", "c", costs=["length"])
    with pytest.raises(OptionError, match=r"must name costs \(length\), got .* Did you mean 'length'\?"):
        pareto_paths(graph, "a", "c", at_most={"lenght": 3.0})
    with pytest.raises(OptionError, match=r"at least 0, got 30\.0; or give bounds by name.*'length': 30\.0"):
        pareto_paths(graph, "a", "c", at_most=[30.0])
    with pytest.raises(OptionError, match="have no names"):
        pareto_paths(plain, 0, 1, at_most={"length": 3.0})
    with pytest.raises(GraphError, match="no node is called 'z'"):
        graph.node("z")
    with pytest.raises(GraphError, match="no labels"):
        plain.node("a")
    for search in (supported_paths, capped_mean_paths):
        with pytest.raises(GraphError, match=r"graph must be a Graph of hpop.search.*Graph.from_networkx"):
            search(GOOD, "a", "c", **({"integral": 0, "duration": 1} if search is capped_mean_paths else {}))


def test_reprs_say_what_is_counted():
    graph = Graph.from_networkx(GOOD, ["length", "turns"], quanta={"length": 0.5})
    assert repr(graph) == "<Graph: 3 nodes, 4 arcs, 2 costs (sum of length in 0.5, sum of turns in 1)>"
    assert repr(pareto_paths(graph, "a", "c")) == "<ParetoPaths: 1 of length, turns; complete>"
