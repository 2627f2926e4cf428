"""Plan the three trajectories of the study in Becerra et al. 2020 (arXiv 2002.10696) in another museum, and analyse it.

Participants compared the path with the least turns, the shortest path, and the path of a common planner: an RRT under
wheel accelerations, of many runs the one whose curvature changes its sign least often. They felt best with the first
and worst with the last. Needs OMPL: pip install 'hpop[rrt]'. The answers here are SIMULATED: no person gave them.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm
from shapely.plotting import plot_polygon

import hpop
from hpop import study
from hpop.problems.named_rows import NamedRow

HERE = Path(__file__).parent
LINES = {"least turns": ("#009E73", "-"), "shortest": ("#0072B2", "--"), "RRT": ("#D55E00", "-.")}
PAPER = {"before": 5.61, "least turns": 9.35, "shortest": 14.96, "RRT": 20.57}  # medians of the SSQ in the paper
FELT = {
    "before": 0.1,
    "least turns": 0.35,
    "shortest": 0.65,
    "RRT": 0.9,
}  # levels of simulated answers, so that medians come near those of the paper
LIKED = {"least turns": 0.3, "shortest": 0.6, "RRT": -0.9}  # preferred is not most comfortable


def main(folder: Path = Path("out/04_study"), runs: int = 10, step: float = 0.5) -> dict[str, hpop.Trajectory]:
    """Plan all three, compare them in a table, draw them on one map, and simulate a study with 36 people."""
    # World and criteria: V, N and D of the paper. The sign changes of the curvature are only reported.
    problem = hpop.Problem(
        world=hpop.World.from_geojson(HERE / "museum.geojson"),
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(2.0, 10.0, 0.0),
        goal=(28.0, 17.0, 0.0),
        criteria=["obstruction", "turns", "length", "curvature_sign_changes"],
    )

    # Plan: two optima of one front, and the baseline (1000 runs in the paper). executor= spreads runs over processes.
    front = problem.solve(planner="lattice", step=step)
    baseline = problem.solve(planner="rrt", runs=runs, seed=1)
    orders = {"least turns": ["turns", "length"], "shortest": ["length", "turns"]}
    optima = {name: front.lexicographic(order) for name, order in orders.items()}
    trajectories = {name: point.item for name, point in optima.items()} | {"RRT": baseline.best("length").item}

    # Compare. On a curve, each stretch that turns to one side counts as a turn.
    rows = {name: problem.evaluate(trajectory) for name, trajectory in trajectories.items()}
    print(f"{'':11} {'V':>6} {'N':>4} {'D (m)':>6} {'sign changes':>13}")
    for name, (v, n, d, flips) in ((name, row.values()) for name, row in rows.items()):
        print(f"{name:11} {v:6.3f} {n:4.0f} {d:6.1f} {flips:13.0f}")
    print(baseline.certificate)

    # Draw all three on one map.
    folder.mkdir(parents=True, exist_ok=True)
    draw(problem, trajectories, rows).savefig(folder / "study.png", dpi=150)

    # Study: three women and three men in each of the six orders.
    design = study.Design.of(
        front,
        [NamedRow(point, name) for name, point in optima.items()],
        baselines=[study.Baseline("RRT", trajectories["RRT"], rows["RRT"])],
        participants=36,
        strata={"sex": ("f", "m")},
        consent="SIMULATED: nobody is asked.",
        protocol=study.Protocol(tasks={"rating": {"every": 10}, "head": {}, "counting": {"least": 2, "most": 5}}),
        seed=7,
    )
    tones = design.scheduled("p01", 1)["tasks"]["counting"]["times"]  # low tones, which participants count
    print(
        f"p01 hears {len(tones)} tones during the first ride, after {', '.join(f'{t:.1f}' for t in tones[:3])}, ... s"
    )
    analyse(design, folder)
    return trajectories


def analyse(design: study.Design, folder: Path) -> None:
    """Simulate answers, repeat the paper's tests on them, and print the results beside those of the paper."""
    letters = {condition.name: condition.id for condition in design.conditions}
    felt = {letters.get(name, name): level for name, level in FELT.items()}
    answers = study.simulate(design, felt, liking={letters[name]: level for name, level in LIKED.items()}, seed=14)
    plan = study.preregistration(design, method="mixed")  # before anyone is asked
    (folder / "preregistration.md").write_text(plan, encoding="utf-8")
    study.analyse(design, answers).save(folder / "report")  # Friedman, Wilcoxon, Holm: see report.html
    result = study.analyse(design, answers, method="paper")
    medians = {str(row["stimulus"])[0]: float(row["median"]) for row in result.tables["scores"][1:4]}
    medians["before"] = float(result.tables["scores"][0]["median"])
    print(f"\n{result.mark}\n{'median SSQ':19} {'simulated':>9} {'paper':>6}")
    for name, printed in PAPER.items():
        print(f"{name:19} {medians[letters.get(name, name)]:9.2f} {printed:6.2f}")

    # An ordinal mixed model, and whether the stimulus before matters (nothing in these simulated answers does).
    for row in study.analyse(design, answers, method="mixed").tables["carry-over"]:
        print(f"{row['test']}: chi-square({row['df']}) {row['chi-square']:.2f}, p {row['p']:.3f}")

    # For groups of equal size, the statistics of Kruskal-Wallis and Dunn obey two identities, also those of the paper.
    z = [float(pair["z"]) for pair in result.tables["pairs"]]
    printed_z = norm.isf(np.array([0.566, 0.008, 0.277]) / 3 / 2)  # absolute z12, z13, z23 from Bonferroni's p
    chi2 = float(result.tables["test"][0]["chi-square"])
    print(f"{'Kruskal-Wallis':19} {chi2:9.3f} {9.035:6.3f}")
    print(f"{'2/3 sum of z^2':19} {2 / 3 * np.square(z).sum():9.3f} {2 / 3 * np.square(printed_z).sum():6.3f}")
    print(f"{'z12 + z23, z13':19} {z[0] + z[2]:.3f}, {z[1]:.3f}; {printed_z[0] + printed_z[2]:.3f}, {printed_z[1]:.3f}")


def draw(problem: hpop.Problem, trajectories: dict[str, hpop.Trajectory], rows: dict[str, dict[str, float]]) -> Figure:
    """Draw the trajectories on the map, with their costs in the legend."""
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    axes = figure.add_subplot(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.set_title("Three ways through the museum: two optima of a lattice, and what an RRT finds")
    grey = {"facecolor": "#b9b9b9", "edgecolor": "#555555", "label": "obstacle"}
    plot_polygon(problem.world.solid(0.0, 1.2), axes, add_points=False, **grey)
    for name, trajectory in trajectories.items():
        v, n, d, flips = rows[name].values()
        states = trajectory.at(np.linspace(0.0, trajectory.duration, 4000))
        colour, dashes = LINES[name]
        which = "run with the fewest sign changes" if name == "RRT" else "on the 0.5 m lattice"
        costs = f"{n:.0f} turns, {d:.1f} m, {100 * v:.1f} % obstructed, curvature sign changes: {flips:.0f}"
        axes.plot(states.x, states.y, dashes, color=colour, linewidth=2.2, label=f"{name} {which}: {costs}")
    for name, (x, y, yaw), above in (("start", problem.start, -1.0), ("goal", problem.goal, 0.7)):
        axes.plot(x, y, "o", color="black", markersize=7)
        axes.text(x - 0.6, y + above, name, weight="bold", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
        axes.annotate(
            "", (x + np.cos(yaw), y + np.sin(yaw)), (x, y), arrowprops={"arrowstyle": "-|>", "linewidth": 1.6}
        )
    figure.legend(loc="outside lower center", frameon=False)
    return figure


if __name__ == "__main__":
    main()
