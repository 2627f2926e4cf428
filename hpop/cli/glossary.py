"""The words that hpop prints, each with what it means here: what ``hpop explain`` says, and docs/glossary.md."""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """A word, what else it is called, and what it means."""

    word: str
    also: tuple[str, ...]
    meaning: str


def _entry(names: str, meaning: str) -> Entry:
    word, *also = (name.strip() for name in names.split(","))
    return Entry(word, tuple(also), " ".join(meaning.split()))


GLOSSARY: dict[str, tuple[Entry, ...]] = {
    "The answer": (
        _entry(
            "front, Pareto front, non-dominated, dominated, efficient",
            """All trajectories that are worth a choice: of a front none is better than another in one cost and no worse
            in the others. One trajectory dominates another if it is at least as good in every cost and better in
            one; what is dominated is left out.""",
        ),
        _entry(
            "certificate",
            """What is claimed of a front, and of what: "exact on the lattice" says that no better trajectory exists on
            that grid of poses, and nothing of paths off it; "local optima" or "supported points" claim less. Each
            planner writes its own, and a union of fronts keeps them all.""",
        ),
        _entry(
            "status, complete, no path, unfinished, interrupted, time limit, label limit, memory limit, point limit, "
            "run limit",
            """How the search ended. Only "complete" and "no path" say that nothing is missing of what the planner can
            find; the others name what stopped it (a limit you gave, or Ctrl-C), and what was found until then is
            valid. "unfinished" is a first answer while the search goes on.""",
        ),
        _entry(
            "knee, compromise",
            """A compromise that hpop proposes: the trajectory deepest below straight mixtures of the extremes. From
            there a little gained in one cost is dearly paid for in the others. It is no law: `hpop pick` chooses
            otherwise.""",
        ),
        _entry(
            "marked",
            """The rows of the table that have a name: the knee, and the trajectory that is least in each cost. They are
            drawn thick in the pictures.""",
        ),
        _entry(
            "for you, preference, preferred",
            """The trajectory that a person is expected to like best, learnt from some choices between two
            (`hpop prefer`). Which one that is comes with a probability: with few answers, or such as contradict one
            another, it is low.""",
        ),
        _entry(
            "regret, expected regret",
            """What a trajectory is expected to cost a person more than the one that would really be the best for
            them, as a share of all that trajectories of the front differ by for them. 2 % is little.""",
        ),
        _entry(
            "share, shares, weights",
            """How much each cost counts for a person, where the whole range of a cost on the front is one unit; they
            add up to 1. The interval beside holds the share in 90 of 100 such cases.""",
        ),
        _entry(
            "ideal, nadir",
            """The ideal is the best value of each cost on the front, taken one by one: no trajectory has all of them.
            The nadir is the worst of each.""",
        ),
        _entry(
            "reported",
            """A value that was computed of each trajectory but not minimised, such as a mean: another trajectory, not
            on the front, may be better in it.""",
        ),
        _entry(
            "planned, executed",
            """Planned costs follow the planning law, in which a robot turns and moves at its full speeds at once.
            Executed ones are of what the robot really does, with ramps from rest to rest.""",
        ),
        _entry(
            "provenance, planned by",
            """Which planner found a trajectory, with which options, weights or bounds.""",
        ),
    ),
    "How good it is": (
        _entry(
            "hypervolume",
            """How much of a box of costs a front dominates; larger is better. Its lines during a plan show how much a
            front still grows, in the scale of the first one (ideal 0, nadir 1, box up to 1.1).""",
        ),
        _entry(
            "gap",
            """After a search that was stopped: how much better a trajectory that it has not found may be, as a share of
            each cost. 0 says that nothing is missing, 0.05 that a missing one is at most 5 % better.""",
        ),
        _entry(
            "supported, supported point, unsupported",
            """A point of the front that is the best for some weights of the costs. What lies in a dent of the front is
            optimal as well, but best for no weights: it is unsupported, and weighted sums never find it.""",
        ),
        _entry(
            "eps, epsilon, tolerance",
            """Options of the exact search by which it returns fewer points, sooner: every optimal point is covered by
            one that is at most (1 + eps) times it, plus the tolerance, in every cost.""",
        ),
        _entry(
            "quantum, quanta",
            """The step in which a cost is compared, in its unit, such as 0.000001 m. Trajectories that differ by less
            are taken for equal; with a coarser one in `quanta` of a scenario fronts are smaller.""",
        ),
        _entry(
            "exact, local optima",
            """Exact: within the motions that a planner considers (a grid, a sample of states) nothing better exists,
            and that is proved. A local optimum is better than all that is near to it, but something quite different
            may be better still.""",
        ),
    ),
    "Costs": (
        _entry(
            "cost, criterion, criteria, objective",
            """What is made small: a criterion gives each trajectory a number of at least 0. `hpop criteria` lists them;
            `hpop explain NAME` says what one of them is.""",
        ),
        _entry(
            "group",
            """The four kinds of criteria: performance P (what is seen), comfort C (of who watches), robot R (energy,
            wear), others O (people about). A note names the groups from which a scenario asks for nothing, lest one
            be forgotten; it is no fault.""",
        ),
        _entry(
            "obstruction, phi",
            """The share of a ball round the camera (2 m in radius) that obstacles fill: 0 in the open, high near walls.
            The criterion is its mean over time.""",
        ),
        _entry(
            "exposure",
            """The obstruction added up over time, in seconds: what the search minimises where obstruction is asked for,
            since a mean does not add up along a path. Ten seconds at an obstruction of 0.1 are an exposure of 1 s.""",
        ),
        _entry(
            "mean, time-mean, max_detour",
            """A time-mean is a sum over a trajectory divided by its duration. It does not add up piece by piece, so its
            sum is minimised in its place; with max_detour the lattice minimises the mean itself, among trajectories
            that are at most so many times as long as the shortest in time.""",
        ),
        _entry(
            "clearance",
            """How far the robot's middle is from the nearest obstacle, closed zone or border of the map, m.""",
        ),
        _entry(
            "turns",
            """How many times the camera is turned in place by more than a degree.""",
        ),
    ),
    "The search": (
        _entry(
            "trajectory, path",
            """A path is where a robot goes, a trajectory also when: motions with times from start to goal.""",
        ),
        _entry(
            "lattice, step, heading, headings",
            """A grid of poses: positions every `step` metres, each with 4, 8 or 16 headings, joined by moves and turns.
            A smaller step finds better trajectories, in more time.""",
        ),
        _entry(
            "roadmap, samples",
            """Poses drawn at random, joined to their neighbours by free motions. It serves any robot, arms too.""",
        ),
        _entry(
            "joined",
            """A start or goal between the poses of a grid is joined to those near by, so that trajectories begin and
            end exactly where they were asked to.""",
        ),
        _entry(
            "label, labels",
            """A path from the start to some pose, with its costs, which the search keeps as none found so far dominates
            it. Their number says how much work a search is (`hpop plan --verbose`).""",
        ),
        _entry(
            "state, edge, states, edges",
            """The graph that is searched: poses of the robot (states), and the motions between them that are free of
            collisions (edges).""",
        ),
        _entry(
            "kernel, compiling",
            """Compiled pieces of the search. They are made once on a machine for each number and kind of costs, some
            seconds, and kept.""",
        ),
        _entry(
            "checkpoint",
            """A file that keeps a search which was stopped: `hpop plan --checkpoint FILE` goes on from there.""",
        ),
    ),
    "People who move": (
        _entry(
            "prediction, horizon",
            """Where somebody is taken to be from now on: at a constant velocity, along waypoints, as recorded, or by
            one of several futures. With a `horizon`, s, no prediction goes farther; afterwards the person is gone, or
            stays.""",
        ),
        _entry(
            "clock, tick",
            """Where people move, `lattice` and `roadmap` count time in ticks of `clock` seconds, 1/20 by default, for
            what a motion costs and whether it is free depends on when it begins. Where nobody moves there is none.""",
        ),
        _entry(
            "hold",
            """The robot stands and waits, for `hold` seconds at least. A plan that begins with a move stands for as
            long as it then takes to get going.""",
        ),
        _entry(
            "arrive_by",
            """The latest arrival, s: plans that come later are left out.""",
        ),
        _entry(
            "margin",
            """Metres that are kept between robot and people, as planned and as executed; 0 is no contact.""",
        ),
        _entry(
            "drift, off the clock",
            """By how much a plan's times differ from those of the clock at most: people are kept clear of all the
            same.""",
        ),
    ),
    "On the way": (
        _entry(
            "drive, plan, announced",
            """A trajectory of a front that is driven, and changed on the way: `hpop drive`. The plan is what is driven
            if nothing changes any more; the announced way is that to the goal, also where it is closed.""",
        ),
        _entry(
            "option, options, leaves at, next turn, same side, keeps on",
            """A way on which a drive may go on: one of the front of the rest, or the present plan. It says when it
            leaves the announced way, how long until the robot turns next, and whether it passes obstacles on the
            same sides.""",
        ),
        _entry(
            "commit",
            """The place from which options begin: the first one later than the deadline at which the robot may leave
            its plan, going straight on or stopping to turn. Until there nothing changes, so nothing jumps.""",
        ),
        _entry(
            "wish, hurry",
            """What somebody aboard asks for, such as "fewer turns" or "hurry": a choice among the options, at the least
            loss in the other costs. The criteria stay the same.""",
        ),
        _entry(
            "deadline",
            """Seconds of processor time in which options are looked for. What is known of the ways is there at once;
            what is missing when time is up is bounded by the gap.""",
        ),
    ),
    "Maps": (
        _entry(
            "free space, usable",
            """Where the robot, as large as it is, touches no obstacle, no closed zone, nobody who stands there, and not
            the border. A start or goal outside of it is not usable; `hpop look` draws it.""",
        ),
        _entry(
            "extent, outline",
            """The area in which the robot must stay: an image's rectangle, or the outline of a building.""",
        ),
        _entry(
            "keep-out zone, zone, speed limit, one-way",
            """Areas with a rule: closed to the robot, to be crossed slowly, or in one direction. Only a closed one
            stops the robot; the other rules are criteria.""",
        ),
        _entry(
            "resolution, scale",
            """Metres a pixel of an image, or metres a unit of a drawing. A door of 0.9 m that is 45 pixels wide gives
            0.02 m.""",
        ),
        _entry(
            "landmark",
            """Something worth seeing, a point with a weight: criteria of performance ask how well it is seen.""",
        ),
    ),
}

HEAD = """# Glossary

Written by `make reference` from what `hpop explain WORD` says in a terminal; do not edit. That explains each criterion,
planner, robot and goal by its name, too.
"""


def entries() -> list[Entry]:
    """Return all entries, in order."""
    return [entry for section in GLOSSARY.values() for entry in section]


def page() -> str:
    """Return the glossary as Markdown."""
    parts = [HEAD]
    for heading, section in GLOSSARY.items():
        parts.append(f"## {heading}\n")
        for word, also, meaning in section:
            others = f" ({', '.join(also)})" * bool(also)
            parts.append(f"**{word}**{others}: {meaning}\n")
    return "\n".join(parts)
