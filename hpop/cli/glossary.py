"""Glossary of the words that hpop prints, for ``hpop explain`` and docs/glossary.md."""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """Word with its synonyms and its meaning."""

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
            """The trajectories that are worth a choice. One trajectory dominates another if it is at least as good in
            every cost and better in one. The front holds one trajectory for each optimal trade-off: no other one
            dominates it.""",
        ),
        _entry(
            "certificate",
            """What a planner claims about a front, and for which set of trajectories. "Exact on the lattice" says that
            no better trajectory exists on that grid of poses; trajectories off the grid may be better. "Local optima"
            and "supported points" are weaker claims. A joint front has the certificates of all its planners.""",
        ),
        _entry(
            "status, complete, no path, unfinished, interrupted, time limit, label limit, memory limit, "
            "point limit, run limit",
            """How the search ended. With "complete" and "no path", the planner has found everything that it can find.
            "Unfinished" is a first result while the search goes on. The other words name what stopped it: a limit that
            you set, or Ctrl-C. The trajectories found until then are valid.""",
        ),
        _entry(
            "knee, compromise",
            """The compromise that hpop proposes. With two costs, the front is a curve that bends towards low costs, and
            the knee is the point deepest in the bend. If you leave the knee, a small gain in one cost takes a large
            loss in another. You need not take it: `hpop pick` chooses by your own rule.""",
        ),
        _entry(
            "point, row",
            """A trajectory of the front with its costs. Tables number the rows from 0.""",
        ),
        _entry(
            "provenance",
            """Says how a point of the front was found: by which planner, with which options.""",
        ),
        _entry(
            "marked",
            """Rows of the table that have a name: the knee, and the trajectory with the least of each cost. Pictures
            draw them thick.""",
        ),
        _entry(
            "for you, preference, preferred",
            """The trajectory that a person is expected to like best, learnt from some choices between two trajectories
            (`hpop prefer`). It comes with a probability, which is low after few answers or contradictory ones.""",
        ),
        _entry(
            "regret, expected regret",
            """What a person is expected to lose with this trajectory, compared with the best one for that person. It is
            a share of the difference between the best and the worst trajectory of the front: 2 % is little.""",
        ),
        _entry(
            "share, shares, weights",
            """How much a cost counts for a person. Each cost is first scaled so that its range on the front is 1; the
            shares of all costs add up to 1. The true share lies in the interval beside it in 90 of 100 cases.""",
        ),
        _entry(
            "ideal, nadir",
            """The ideal is the best value of each cost on the front, taken separately; no trajectory reaches all of
            them. The nadir is the worst value of each cost on the front.""",
        ),
        _entry(
            "reported",
            """A value that was computed for each trajectory but not minimised, such as a mean. A trajectory that is not
            on the front may have a lower value.""",
        ),
        _entry(
            "planned, executed",
            """Planned costs assume that the robot moves at full speed at once and lose a fixed time at each turn.
            Executed costs are those of the real motion, which speeds up and slows down.""",
        ),
    ),
    "How good it is": (
        _entry(
            "hypervolume",
            """How much of a box of costs a front dominates; larger is better. During a plan, its curve shows how much
            the front still grows. On its scale the best costs of the first front are 0 and the worst ones 1; the box
            ends at 1.1. Two runs of one problem may have different first fronts, since these depend on the time of the
            search. So do not compare their hypervolumes.""",
        ),
        _entry(
            "gap",
            """Says how good the result of a stopped search is. It bounds how much better a missing trajectory can be,
            as a share of each cost. With a gap of 0, none is missing. With a gap of 0.05, a missing one is at most 5 %
            better.""",
        ),
        _entry(
            "supported, supported point, unsupported",
            """A supported point has the least weighted sum of the costs for some choice of weights. Other points of the
            front are unsupported: they are optimal trade-offs too, but for every choice of weights another point has a
            smaller sum. So a search by weighted sums never finds them.""",
        ),
        _entry(
            "eps, epsilon, tolerance",
            """Options that make the exact search return fewer points, sooner. For every optimal point, a returned point
            costs at most (1 + eps) times as much, plus the tolerance, in every cost.""",
        ),
        _entry(
            "quantum, quanta",
            """The smallest difference of a cost that counts, in the cost's unit, such as 0.000001 m. Trajectories whose
            costs differ by less count as equal. A coarser quantum (`quanta` of a scenario) gives a smaller front.""",
        ),
        _entry(
            "exact, local optima",
            """Exact is a claim about the graph that was searched, such as a grid of poses: no other path on it is
            better than a returned one in one cost and as good in the others. A local optimum is better than all similar
            trajectories; a very different one may be better still.""",
        ),
    ),
    "Costs": (
        _entry(
            "cost, criterion, criteria, objective",
            """A criterion gives each trajectory a number of at least 0, its cost; smaller is better. `hpop criteria`
            lists the criteria, and `hpop explain NAME` describes one.""",
        ),
        _entry(
            "group",
            """The four kinds of criteria: performance P (what the camera sees), comfort C (of the viewer), robot R
            (energy, wear) and others O (people nearby). A note names the groups that a scenario leaves out. It is a
            reminder, not an error.""",
        ),
        _entry(
            "obstruction, phi",
            """The share of a ball around the camera (radius 2 m) that obstacles fill: 0 in the open, high near walls.
            The criterion is its mean over time.""",
        ),
        _entry(
            "exposure",
            """The obstruction added up over time, in seconds: ten seconds at an obstruction of 0.1 are an exposure of 1
            s. If you list obstruction, searches minimise the exposure, because a mean does not add up along a path.""",
        ),
        _entry(
            "mean, time-mean, max_detour",
            """A time-mean is a sum over a trajectory divided by its duration. It does not add up along a path, so
            searches minimise the sum and report the mean. With `max_detour`, the exact search minimises the mean itself
            among trajectories that last at most that factor times the least duration.""",
        ),
        _entry(
            "clearance",
            """The distance from the robot's centre to the nearest obstacle, closed zone or border of the map, in
            metres. The criterion `clearance` is a cost: the shortfall of the least distance on the way below `enough`,
            by default 1 m. A path that comes as near as 0.4 m costs 0.6 m.""",
        ),
        _entry(
            "turns",
            """The number of times that the camera turns in place by more than one degree.""",
        ),
    ),
    "The search": (
        _entry(
            "trajectory, path, motion",
            """A path is a route through space. A trajectory also has times: it is a sequence of motions from start to
            goal, such as straight moves, turns in place and holds.""",
        ),
        _entry(
            "lattice, step, heading, headings",
            """A grid of poses: positions every `step` metres, each with 4, 8 or 16 headings, joined by moves and turns.
            A smaller step finds better trajectories and takes longer.""",
        ),
        _entry(
            "roadmap, samples",
            """A graph of random poses, joined to their neighbours by free motions. It works for any robot, including
            arms.""",
        ),
        _entry(
            "far, link, links",
            """In a roadmap of configurations, each random state is linked to its nearest neighbours. It is also linked
            to `far` states that are farther away, so that long motions are possible too. For each of these, a part of
            all states is drawn at random, and the nearest state in it is linked.""",
        ),
        _entry(
            "guide, guides",
            """A path that random trees find before the roadmap of an arm is made. Guides show where its samples are
            worth drawing.""",
        ),
        _entry(
            "warm start, warm_start",
            """A path of another planner, from which a planner such as `smoothing` starts to improve.""",
        ),
        _entry(
            "joined",
            """A start or goal between the poses of a grid is joined to poses nearby, so that trajectories begin and end
            exactly where you asked.""",
        ),
        _entry(
            "label, labels",
            """A partial path of the search, from the start to some state, with its costs. It is kept while no other
            partial path dominates it. The number of labels measures the work of a search (`hpop plan --verbose`).""",
        ),
        _entry(
            "state, edge, graph, states, edges",
            """A graph is what a planner searches: states (poses of the robot, or positions of its joints), and edges
            (free motions between them).""",
        ),
        _entry(
            "tour, stop, stops, visit, dwell, order",
            """A tour visits stops on the way from start to goal, in a given order or in any order. A stop is a set of
            robot states, such as those from which the camera sees a landmark. During a visit, the robot stands still
            for the dwell (s). An optional stop may be skipped: the criterion `stops_missed` counts skipped stops.""",
        ),
        _entry(
            "kernel, compiling",
            """A compiled part of the search. A plan with a new number or kind of costs compiles its kernels first,
            which takes some seconds. They are stored, so this happens once on each machine.""",
        ),
        _entry(
            "checkpoint",
            """A file that holds a stopped search: `hpop plan --checkpoint FILE` continues it.""",
        ),
    ),
    "People who move": (
        _entry(
            "prediction, horizon",
            """Where a person is expected to be from now on. The person walks at a constant velocity, along waypoints,
            on a recorded track, or by one of several hypotheses. A prediction ends after `horizon` seconds; from then
            on the person is gone, or stays.""",
        ),
        _entry(
            "clock, tick",
            """Among moving people, the cost and the safety of a motion depend on when it begins. So planners count time
            in ticks of `clock` seconds, by default 0.05 s. Without moving people there is no clock.""",
        ),
        _entry(
            "hold",
            """A wait: the robot stands still for at least `hold` seconds. A plan that begins with a move first stands
            for as long as the robot needs to accelerate.""",
        ),
        _entry(
            "margin",
            """The distance in metres that the robot keeps from people, as planned and as executed. A margin of 0 only
            excludes contact.""",
        ),
        _entry(
            "drift, off the clock",
            """The planner counts time in whole ticks, so its times differ slightly from those of the real motion. The
            drift is the largest difference. The distance to people is checked at the real times.""",
        ),
    ),
    "On the way": (
        _entry(
            "drive, plan, announced",
            """A drive executes a trajectory of a front, and may change it on the way (`hpop drive`). The plan is the
            trajectory that is driven if nothing changes. The announced path is the whole planned path to the goal, even
            if a part of it is closed now.""",
        ),
        _entry(
            "option, options, leaves at, next turn, same side, keeps on",
            """A way to continue a drive: a trajectory to the goal from where the robot will be, or the present plan.
            Its columns say when it leaves the announced path, when the robot turns next, and whether it passes
            obstacles on the same sides.""",
        ),
        _entry(
            "commit",
            """The state at which options begin. The search has some time, the deadline. The commit is the first state
            after it at which the robot can leave its plan, straight on or by stopping to turn. Until then the plan
            stays as it is, so the motion never jumps.""",
        ),
        _entry(
            "wish, hurry",
            """A request of the viewer, such as "fewer turns" or "hurry". The robot takes the option that fulfils it
            with the least loss in the other costs.""",
        ),
    ),
    "Maps": (
        _entry(
            "scenario",
            """A text file (YAML) with one planning problem: map, robot, start, goal, criteria and planner. `hpop plan`
            solves it.""",
        ),
        _entry(
            "reader",
            """The part of hpop that reads one kind of map, such as `image` or `geojson`.""",
        ),
        _entry(
            "free space, usable",
            """The positions at which the whole robot touches no obstacle, keep-out zone, standing person or border. A
            start or goal outside the free space cannot be used. `hpop look` draws it.""",
        ),
        _entry(
            "extent, outline",
            """The area in which the robot must stay: the rectangle of an image, or the outline of a building.""",
        ),
        _entry(
            "keep-out zone, zone, speed limit, one-way",
            """An area with a rule. A keep-out zone is closed to the robot. A speed limit or a direction does not stop
            the robot: criteria measure how far it breaks the rule.""",
        ),
    ),
    "Files that `hpop plan` writes": (
        _entry("front.json", "The front: all trajectories with their costs. `hpop show` and `hpop pick` read it."),
        _entry("front.html", "A page to choose from the front in a browser; it needs no server and no network."),
        _entry("ride.html", "A page that shows what the camera sees along the trajectories (`hpop ride`)."),
        _entry("map.png, map", "Picture of all trajectories from above, over the obstacles."),
        _entry("front.png", "Picture of the costs: what one of them gains where another one loses."),
        _entry("trace.png, trace", "Picture of when, along the knee's trajectory, each cost arises."),
        _entry("where.png, where", "Picture of where, along the knee's trajectory, each cost arises."),
        _entry("side.png", "Picture of the camera's paths from the side, if its height changes."),
        _entry("states.png", "Picture of each further state over time, such as the joints of an arm, with its limits."),
        _entry(
            "felt.png", "Picture of speed, and acceleration in g, that a passenger feels along the way, as executed."
        ),
        _entry("encounters.png", "Picture of the knee's path over time, among people who move."),
    ),
}

HEAD = """# Glossary

The words that hpop prints. `hpop explain WORD` shows the same text in a terminal, and explains each criterion, planner,
robot and goal by its name. `make reference` writes this page; do not edit it.
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
            others = f" ({', '.join(also)})" if also else ""
            parts.append(f"**{word}**{others}: {meaning}\n")
    return "\n".join(parts)
