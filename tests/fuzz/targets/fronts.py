"""Fronts and checkpoints that were saved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from harness import Wrong
from mutations import Rng, bent_bytes, bent_tree, hostile
from verdicts import asked, shown, verdict

import hpop
from hpop.problems.verify import verify
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, pareto_paths
from hpop.search.machinery.checkpoint import CHECKSUM, LENGTH, MAGIC
from hpop.world import Box, Cylinder, Hull, Solid, pose_at
from targets.given import BLOCK, as_json, box, command

_FRONT: list[bytes] = []


def saved_front() -> bytes:
    """Return a small saved front of the room; planned once."""
    if not _FRONT:
        world = hpop.World.from_solids(
            [
                Solid(Box((0.5, 0.5, 1.0)), pose_at((3.0, 2.0, 0.5), rpy=(0.1, 0.0, 0.0)), "case"),
                Solid(Hull(BLOCK["vertices"]), pose_at((5.5, 0.5, 0.0))),
                Solid(Cylinder(0.1, 1.0), pose_at((0.5, 3.0, 0.5))),
            ],
            extent=box(0, 0, 6, 4),
        )
        problem = hpop.Problem(
            world, hpop.DifferentialDrive(), (1, 1, 0), (5, 3, None), ["obstruction", "turns", "length"]
        )
        path = Path("front.json")
        problem.solve("lattice", step=0.5).save(path)
        _FRONT.append(path.read_bytes())
        path.unlink()
    return _FRONT[0]


def front(rng: Rng, folder: Path) -> str:
    path = folder / "front.json"
    if rng.random() < 0.3:
        path.write_bytes(bent_bytes(saved_front(), rng))
    else:
        path.write_bytes(as_json(bent_tree(json.loads(saved_front()), rng)).encode("utf-8", "surrogatepass"))

    def read() -> None:
        loaded = hpop.Front.load(path)
        problem = hpop.Problem.from_description(loaded.problem or {})
        verify(problem, loaded)
        loaded.save(folder / "again.json")

    return verdict(read)


def show(rng: Rng, folder: Path) -> str:
    tree = bent_tree(json.loads(saved_front()), rng)
    (folder / "front.json").write_bytes(as_json(tree).encode("utf-8", "surrogatepass"))
    return command(["show", str(folder)])


def pick(rng: Rng, folder: Path) -> str:
    """Pick from a bent front by names and numbers that may be hostile, and print the picked row."""
    tree = bent_tree(json.loads(saved_front()), rng) if rng.random() < 0.7 else json.loads(saved_front())
    (folder / "front.json").write_bytes(as_json(tree).encode("utf-8", "surrogatepass"))
    named = [str(hostile(rng))[:200].replace("\0", "") if rng.random() < 0.3 else "length" for _ in range(2)]
    number = str(hostile(rng))[:200].replace("\0", "") if rng.random() < 0.3 else "9"
    way = (["--least", named[0]], ["--wish", f"{named[0]}={number}"], ["--row", number], ["--knee"])[rng.integers(4)]
    among = ["--at-most", f"{named[1]}={number}"] if rng.random() < 0.5 else []
    return command(["pick", str(folder), *way, *among, "--csv", str(folder / "camera.csv")])


def checkpoint(rng: Rng, folder: Path) -> str:
    """Bend an array of a checkpoint and correct its checksum: refused, or the search ends with an equal front."""
    costs = int(rng.integers(2, 5))
    maker = np.random.default_rng(int(rng.integers(3)))
    tails, heads = maker.integers(0, 60, (2, 400))
    graph = Graph.from_arcs(60, tails, heads, maker.integers(1, 30, (400, costs)))
    method = ("auto", "general")[rng.integers(2)]
    path = folder / "search.ckpt"
    is_free = maker.random(400) < 0.8
    options: dict[str, Any] = {"method": method, "free": (None, is_free.__getitem__)[rng.integers(2)]}
    expected = pareto_paths(graph, 0, 59, **options)
    limit = Budget(max_labels=int(rng.integers(1, expected.stats.labels_generated)))
    begun = pareto_paths(graph, 0, 59, checkpoint=path, budget=limit, **options)
    if begun.status is Status.COMPLETE or not path.exists():
        return "accepted"
    path.write_bytes(_forged(path.read_bytes(), rng))
    found: list[Any] = []
    message = asked(lambda: found.append(pareto_paths(graph, 0, 59, checkpoint=path, **options)))
    if message:
        return shown(message)
    if not np.array_equal(np.unique(found[0].costs, axis=0), np.unique(expected.costs, axis=0)):
        # Labels can be left out unnoticed only by one who makes the evidence of them anew: two arrays that agree.
        raise Wrong("a forged checkpoint leads to another front")
    return "accepted"


def _forged(data: bytes, rng: Rng) -> bytes:
    """Change parts of one array of a checkpoint, and correct its checksum."""
    import hashlib

    length = int.from_bytes(data[len(MAGIC) : len(MAGIC) + LENGTH], "little")
    begin = len(MAGIC) + LENGTH + length
    header = json.loads(data[len(MAGIC) + LENGTH : begin])
    body = bytearray(data[begin:-CHECKSUM])
    tables = [(dtype, int(np.prod(shape))) for _, dtype, shape in header["arrays"]]
    chosen = int(rng.integers(len(tables)))
    at = sum(np.dtype(dtype).itemsize * count for dtype, count in tables[:chosen])
    dtype, count = np.dtype(tables[chosen][0]), tables[chosen][1]
    array = np.frombuffer(bytes(body[at : at + dtype.itemsize * count]), dtype).copy()
    if array.size:
        places = rng.integers(0, array.size, int(rng.integers(1, 4)))
        extremes = np.array([-1, 0, 1, 7, 2**15, 2**30, -(2**30)])
        with np.errstate(over="ignore"):
            array[places] = (rng.choice(extremes, places.size)).astype(dtype)
    body[at : at + dtype.itemsize * count] = array.tobytes()
    whole = data[:begin] + bytes(body)
    return whole + hashlib.blake2b(whole, digest_size=CHECKSUM).digest()
