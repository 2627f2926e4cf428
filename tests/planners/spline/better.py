"""Random questions for splines, and a search for better splines near one.

The search shares nothing with planners. It reads knots, speeds and times of a spline, and moves them along differences
of reported costs and at random. A spline is better if it costs less, no other cost passes its bound, its joints keep
their limits by closed forms written here, and the arm's certificate proves it free.
"""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.models.serial_arm.laws import rate_of
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world.geometry.solids import Box, Solid
from tests.models.serial_arm.arms import arm6, crane

LOOK = {"look_at": {"target": [0.6, 0.0, 0.5]}}
QUESTIONS = [
    (["duration", "rotation", LOOK], "rotation"),
    (["duration", "rotation", LOOK], "duration"),
    (["duration", "rotation", LOOK], "look_at"),
    (["duration", "angular_acceleration"], "angular_acceleration"),
    (["camera_length", "joint_length", "duration"], "camera_length"),
    (["camera_length", "joint_length", "duration"], "joint_length"),
    (["joint_energy", "duration"], "joint_energy"),
    (["joint_energy", "rotation"], "rotation"),
    (["singularity", "duration"], "singularity"),
]
NEAR = 0.08  # m: bodies that are farther apart bound no step
APART = 1.6e-3  # m between bodies; the certificate needs 1 mm
FRACTIONS = np.linspace(1 / 12, 1, 12)  # of a piece, at which distances are bounded
SLACK = 1e-9
ATTEMPTS = 1000  # joints drawn among the same posts; beyond it the posts may enclose the arm


def box(place, size):
    pose = np.eye(4)
    pose[:3, 3] = place
    return Solid(Box(size), pose)


def shelf():
    sides = [box((0.6, y, 0.5), (0.3, 0.02, 0.6)) for y in (0.4, -0.4)]
    boards = [box((0.6, 0.0, z), (0.3, 0.8, 0.02)) for z in (0.35, 0.75)]
    return hpop.World.from_solids([*sides, *boards, box((0.0, 0.0, -0.06), (2.0, 2.0, 0.1))])


def posts(rng):
    places = rng.uniform((-0.9, -0.9, 0.2), (0.9, 0.9, 0.9), (6, 3))
    return hpop.World.from_solids([box(place, tuple(rng.uniform(0.05, 0.25, 3))) for place in places])


def random_question(seed, folder):
    """Return a problem, a path through random joints, and the cost to minimise."""
    rng = np.random.default_rng(seed)
    while (question := question_in_a_world(seed, rng, folder)) is None:
        pass
    return question


def question_in_a_world(seed, rng, folder):
    """Return a question in a random world, or None if no free path is drawn there."""
    if seed % 3 == 1:
        model, world = crane(folder), posts(rng)
    else:
        model = arm6(acceleration=float(rng.uniform(2, 6)))
        world = posts(rng) if seed % 3 else shelf()
    names, collision = model.space.names, model.collision(world)
    low = np.maximum(np.where(np.isfinite(model.space.low), model.space.low, -2.2), -2.2)
    high = np.minimum(np.where(np.isfinite(model.space.high), model.space.high, 2.2), 2.2)
    count, rows = int(rng.integers(2, 4)), []
    for _ in range(ATTEMPTS):
        if len(rows) == count:
            break
        rows.append(rng.uniform(low, high))
        path = Trajectory.through(model, States(**dict(zip(names, np.array(rows[-2:]).T, strict=True))))
        free = collision.states_free(path.states).all()
        free = free and all(collision.motions_free(m).all() for _, m in path.batches(world))
        if not free or (len(rows) > 1 and np.abs(rows[-1] - rows[-2]).max() < 0.8):
            rows.pop()
    if len(rows) < count:
        return None
    path = Trajectory.through(model, States(**dict(zip(names, np.array(rows).T, strict=True))))
    criteria, minimise = QUESTIONS[seed // 3 % len(QUESTIONS)]
    return hpop.Problem(world, model, tuple(rows[0]), tuple(rows[-1]), criteria), path, minimise


class BetterSplines:
    """Search near splines of one problem; ``bounds`` (k,) of the costs, ``longest`` s."""

    def __init__(self, problem, minimise, bounds, longest, seed=0):
        self.problem, self.bounds, self.longest = problem, np.array(bounds), longest
        self.index = [criterion.name for criterion in problem.criteria].index(minimise)
        self.names, law, space = problem.model.space.names, problem.model.laws["spline"], problem.model.space
        self.speeds, self.accelerations = np.array(law.speeds), np.array(law.accelerations)
        turning = np.array([name in space.turning for name in self.names])
        self.low, self.high = np.where(turning, -np.inf, space.low), np.where(turning, np.inf, space.high)
        self.collision = problem.model.collision(problem.world)
        self.rng = np.random.default_rng(seed)

    def improvable(self, spline, rounds=15, random=4):
        """Return the share of its cost by which a spline can be made better."""
        x = self.read(spline)
        (costs,) = self.costs([spline])
        before, limits = costs[self.index], np.maximum(self.bounds, costs) * (1 + SLACK) + SLACK
        limits[self.index] = np.inf
        longest, unit = max(self.longest, x[-1]) * (1 + SLACK), self.units(x)
        bends, last, size = 1e-2 * np.eye(x.size), None, 0.05
        for _ in range(rounds):
            slopes = self.slopes(x)
            slope = slopes[self.index] * unit / before
            if last is not None:
                bends = damped(bends, (x - last[0]) / unit, slope - last[1])
            last, rows = (x, slope), self.rows(x, slopes, limits - costs)
            better = None
            while better is None and size > 2e-5:
                step = self.step(bends, slope, rows, unit, size, (longest - x[-1]) / unit[-1])
                better = self.better([x + step, x + 0.5 * step], costs, limits, longest)
                size *= 1.6 if better else 0.4
            better = better or self.better(list(self.displaced(x, unit, random)), costs, limits, longest)
            if better is None:
                break
            (x, costs), size = better, min(0.3, max(size, 1e-3))
        return 1 - costs[self.index] / before

    def better(self, tried, costs, limits, longest):
        """Return the best of some splines that is better, and its costs; or None."""
        tried = [self.kept(x) for x in tried]
        tried = [x for x in tried if x[-1] <= longest and self.within(x)]
        if not tried:
            return None
        reported = self.costs([self.spline(x) for x in tried])
        for i in np.argsort(reported[:, self.index]):
            less = reported[i, self.index] < costs[self.index] * (1 - 1e-6) - SLACK
            if less and (reported[i] <= limits).all() and self.free(tried[i]):
                return tried[i], reported[i]
        return None

    def displaced(self, x, unit, count):
        """Yield splines displaced near a random knot."""
        n, inner = len(self.names), len(self.ends) - 2
        for size in np.repeat((1e-2, 1e-3), count):
            near = np.exp(-0.5 * ((np.arange(inner) - self.rng.integers(inner)) / self.rng.uniform(0.5, 3)) ** 2)
            by = np.zeros(x.size)
            by[:-1] = (self.rng.normal(size=(2, inner, n)) * near[:, None]).ravel()
            yield x + size * by * unit

    # A spline as numbers: inner knots, inner speeds by the share of the total time, and the total time.

    def read(self, spline):
        rows = spline.states
        clock = rows.clock - rows.clock[0]
        self.shares, last = np.diff(clock) / clock[-1], clock[-1]
        self.ends = np.stack([getattr(rows, name) for name in self.names], axis=1)
        rates = np.stack([getattr(rows, rate_of(name)) for name in self.names], axis=1)
        return np.concatenate([self.ends[1:-1].ravel(), last * rates[1:-1].ravel(), [last]])

    def units(self, x):
        inner = len(self.ends) - 2
        return np.concatenate([np.ones(inner * len(self.names)), np.tile(self.speeds, inner) * x[-1], x[-1:]])

    def columns(self, x):
        """Return knots and slopes (N + 1, n), and the total time."""
        knots, slopes = self.ends.copy(), np.zeros_like(self.ends)
        knots[1:-1], slopes[1:-1] = x[:-1].reshape(2, -1, len(self.names))
        return knots, slopes, x[-1]

    def spline(self, x, pieces=slice(None)):
        knots, slopes, last = self.columns(x)
        first, end, _ = pieces.indices(len(self.shares))
        clock = np.append(0.0, np.cumsum(self.shares)) * last
        named = dict(zip(self.names, knots[first : end + 1].T, strict=True))
        named |= dict(zip(map(rate_of, self.names), slopes[first : end + 1].T / last, strict=True))
        return Trajectory(
            self.problem.model, States(**named, clock=clock[first : end + 1]), ("spline",) * (end - first)
        )

    def costs(self, splines):
        return trajectory_costs(self.problem.criteria, splines, self.problem.world)

    def shapes(self, x):
        """Return slopes at quarters and where they are extreme, second derivatives at the ends, and control points."""
        (knots, slopes, _), width = self.columns(x), self.shares[:, None]
        chords = np.diff(knots, axis=0) / width
        begin = (6 * chords - 4 * slopes[:-1] - 2 * slopes[1:]) / width
        end = (-6 * chords + 2 * slopes[:-1] + 4 * slopes[1:]) / width
        crossing = begin * end < 0
        peak = np.where(crossing, begin / np.where(crossing, begin - end, 1), 0)
        at = [slopes[:-1] + width * u * (begin + u * (end - begin) / 2) for u in (0, 0.25, 0.5, 0.75, 1, peak)]
        points = np.concatenate([knots[:-1] + width / 3 * slopes[:-1], knots[1:] - width / 3 * slopes[1:]])
        return np.concatenate(at), np.concatenate([begin, end]), points

    def kept(self, x):
        """Return the spline, slowed down as far as the limits of speeds and accelerations require."""
        slopes, bends, _ = self.shapes(x)
        fast, bent = np.abs(slopes / self.speeds).max(), np.abs(bends / self.accelerations).max()
        return np.append(x[:-1], max(x[-1], fast, np.sqrt(bent)))

    def within(self, x):
        points = np.concatenate([self.columns(x)[0], self.shapes(x)[2]])
        return ((self.low - SLACK <= points) & (points <= self.high + SLACK)).all()

    def free(self, x):
        return all(self.collision.motions_free(m).all() for _, m in self.spline(x).batches(self.problem.world))

    def slopes(self, x):
        """Return gradients (k, V) of the reported costs, by differences over the two pieces that a knot moves."""
        n, inner, unit = len(self.names), len(self.ends) - 2, self.units(x)
        pieces = [slice(i, i + 2) for _ in range(2) for i in range(inner) for _ in range(n)] + [
            slice(0, len(self.shares))
        ]
        places = sorted({(part.start, part.stop) for part in pieces})
        splines = [self.spline(x, slice(*place)) for place in places]
        for v, part in enumerate(pieces):
            moved = x.copy()
            moved[v] += 1e-5 * unit[v]
            splines.append(self.spline(moved, part))
        costs = self.costs(splines)
        at = [places.index((part.start, part.stop)) for part in pieces]
        return (costs[len(places) :] - costs[at]).T / (1e-5 * unit)

    def rows(self, x, slopes, room):
        """Return linear limits, matrix and bounds: shapes, costs, and distances of bodies."""
        fast, bent, points = self.shapes(x)
        high, low = (np.broadcast_to(side, points.shape) for side in (self.high, self.low))
        limits = [
            *(self.speeds * x[-1] - sign * fast for sign in (1, -1)),
            *(self.accelerations * x[-1] ** 2 - sign * bent for sign in (1, -1)),
            high - points,
            points - low,
        ]

        def values(x):
            fast, bent, points = self.shapes(x)
            return np.concatenate([side.ravel() for side in (fast, bent, points)])

        base, unit = values(x), self.units(x)
        changes = []
        for v in range(x.size):
            moved = x.copy()
            moved[v] += 1e-6 * unit[v]
            changes.append((values(moved) - base) / (1e-6 * unit[v]))
        by_fast, by_bent, by_points = np.split(np.array(changes).T, np.cumsum([fast.size, bent.size]))
        by_time = np.zeros((fast.size, x.size)), np.zeros((bent.size, x.size))
        by_time[0][:, -1] = np.tile(self.speeds, fast.shape[0])
        by_time[1][:, -1] = np.tile(2 * x[-1] * self.accelerations, bent.shape[0])
        matrices = [sign * by_fast - by_time[0] for sign in (1, -1)] + [sign * by_bent - by_time[1] for sign in (1, -1)]
        apart, far = self.distances(x)
        matrix = np.concatenate([*matrices, by_points, -by_points, apart, slopes])
        bounds = np.concatenate([*(np.maximum(side, 0).ravel() for side in limits), far, room])
        use = np.isfinite(bounds)
        return matrix[use], bounds[use]

    def distances(self, x):
        (knots, slopes, _), n, inner = self.columns(x), len(self.names), len(self.ends) - 2
        width, places = self.shares[:, None], []
        for u in FRACTIONS:
            ends = (1 - u) ** 2 * ((1 + 2 * u) * knots[:-1] + u * width * slopes[:-1])
            places.append(ends + u**2 * ((3 - 2 * u) * knots[1:] - (1 - u) * width * slopes[1:]))
        names = dict(zip(self.names, np.concatenate(places).T, strict=True))
        pairs = self.collision.separations(States(**names), NEAR)
        matrix = np.zeros((pairs.distance.size, x.size))
        for row, owner, gradient in zip(matrix, pairs.owner, pairs.gradient, strict=True):
            piece, u = owner % len(self.shares), FRACTIONS[owner // len(self.shares)]
            wide = self.shares[piece]
            first = (1 - u) ** 2 * (1 + 2 * u), u * (1 - u) ** 2 * wide
            last = u * u * (3 - 2 * u), -u * u * (1 - u) * wide
            for knot, weights in ((piece - 1, first), (piece, last)):
                if 0 <= knot < inner:
                    for part, weight in enumerate(weights):
                        at = (part * inner + knot) * n
                        row[at : at + n] -= weight * gradient
        return matrix, pairs.distance - np.minimum(APART, pairs.distance)

    def step(self, bends, slope, rows, unit, size, later):
        """Return the best step within a box, by a quadratic program."""
        matrix, bounds = rows[0] * unit, rows[1]
        reach = np.append(np.full(unit.size - 1, size), size)
        reach[(unit.size - 1) // 2 : -1] *= 4
        above = np.append(reach[:-1], min(size, max(later, 0)))
        use = np.abs(matrix) @ reach > bounds
        scale = np.abs(matrix[use]).max(axis=1)
        box = np.eye(unit.size)
        matrix = sparse.csc_matrix(np.concatenate([matrix[use] / scale[:, None], box, -box]))
        bounds = np.concatenate([bounds[use] / scale, above, reach])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        cones = [clarabel.NonnegativeConeT(bounds.size)]
        solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(bends)), slope, matrix, bounds, cones, settings)
        step = np.array(solver.solve().x) * unit
        return step if np.isfinite(step).all() else np.zeros(unit.size)


def damped(bends, moved, changed):
    """Return the curvature after a step, by Powell's damped formula of Broyden, Fletcher, Goldfarb and Shanno."""
    pushed = bends @ moved
    along, gained = moved @ pushed, moved @ changed
    if along < 1e-16:
        return bends
    share = 1.0 if gained >= 0.1 * along else 0.9 * along / (along - gained)
    kept = share * changed + (1 - share) * pushed
    return bends - np.outer(pushed, pushed) / along + np.outer(kept, kept) / (moved @ kept)
