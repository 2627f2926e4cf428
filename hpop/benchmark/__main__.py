"""Command ``python -m hpop.benchmark``: run a program on the instances, solve one with hpop, convert graph files."""

from __future__ import annotations

from pathlib import Path

import click

from hpop.benchmark import READERS, read_graph, read_tntp, running, write_graph
from hpop.errors import HpopError
from hpop.runtime.limits import Budget
from hpop.search import pareto_paths

FILE = click.Path(path_type=Path, dir_okay=False)


class _Group(click.Group):
    """Group of commands that prints an error of hpop as one line and exits with its code."""

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except HpopError as error:
            click.echo(f"error: {error}", err=True)
            raise SystemExit(error.exit_code) from None


@click.group(cls=_Group)
def main() -> None:
    """Open benchmark of multi-objective shortest paths."""


@main.command()
@click.option("--binary", required=True, help="Command, for example 'CMD {graph} {source} {target}'.")
@click.option(
    "--instances", type=click.Path(path_type=Path), required=True, help="Folder that benchmarks/open/make.py wrote."
)
@click.option("--only", multiple=True, metavar="NAME", help="Instance to run; may be repeated. [default: all]")
@click.option("--time-limit", type=float, default=300.0, show_default=True, help="Seconds for one query.")
@click.option("--first-node", type=click.IntRange(0, 1), default=1, show_default=True, help="Number of the first node.")
@click.option(
    "--count", default="", help="Regular expression for the number of vectors, if the program prints no vectors."
)
@click.option("--clock", default="", help="Regular expression for the program's own seconds in its output.")
@click.option("--out", type=click.Path(path_type=Path), help="Write OUT.md and OUT.csv.")
def run(
    binary: str,
    instances: Path,
    only: tuple[str, ...],
    time_limit: float,
    first_node: int,
    count: str,
    clock: str,
    out: Path | None,
) -> None:
    """Run a program on every query, and compare its fronts with the exact ones.

    The program prints one cost vector per line on standard output. In the command, {graph} is a file,
    {graphs} one file for each cost, {source} and {target} are nodes, {costs} is the number of costs. The exit
    code is 1 if a front differs or a run fails.
    """
    program = running.ForeignProgram(binary, first_node, count, clock)
    results = []
    for result in running.run_program(program, running.read_queries(instances, only), time_limit):
        results.append(result)
        ends = f"{result.instance} {result.source} {result.target}"
        message = f" ({result.message})" if result.message else ""
        click.echo(f"{ends}: {result.front}, {result.seconds:.3f} s, {result.memory:.0f} MB{message}", err=True)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        running.write_tables(results, binary, out)
    click.echo(running.markdown(results), nl=False)
    if any(result.front not in ("equal", "equal size", "time limit") for result in results):
        raise SystemExit(1)


@main.command()
@click.argument("graph", type=FILE)
@click.argument("source", type=int)
@click.argument("target", type=int)
@click.option("--method", type=click.Choice(["auto", "staircase", "general"]), default="auto", show_default=True)
def solve(graph: Path, source: int, target: int, method: str) -> None:
    """Print the exact front of a query.

    Each line is one cost vector; a comment gives the seconds of the search.
    """
    read = read_graph(graph)
    pareto_paths(
        read, source - 1, target - 1, method=method, budget=Budget(max_labels=1)
    )  # compiles or loads the kernels
    paths = pareto_paths(read, source - 1, target - 1, method=method)
    for vector in paths.costs.tolist():
        click.echo(" ".join(map(str, vector)))
    click.echo(f"c seconds {paths.stats.seconds_bounds + paths.stats.seconds_search:.6f}")


@main.command()
@click.argument("form", type=click.Choice(list(READERS)))
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.argument("out", type=FILE)
@click.option("--cost", multiple=True, metavar="COLUMN", help="Cost of tntp: a column, or a ratio of two.")
def convert(form: str, files: tuple[Path, ...], out: Path, cost: tuple[str, ...]) -> None:
    """Convert graph files of another format.

    dimacs takes several files, one for each cost; the other formats take one file.
    """
    if form != "dimacs" and len(files) != 1:
        raise click.UsageError(f"{form} takes one file, got {len(files)}")
    if cost and form != "tntp":
        raise click.UsageError(
            f"--cost applies only to tntp, got {form}; files of other formats have all costs of an arc"
        )
    graph = read_tntp(files, cost) if cost else READERS[form](files)
    write_graph(graph, out)
    click.echo(f"{out}: {graph.nodes} nodes, {graph.arcs} arcs, {graph.criteria} costs")


@main.command()
@click.argument("graph", type=FILE)
@click.argument("source", type=int)
@click.argument("target", type=int)
def add(graph: Path, source: int, target: int) -> None:
    """Solve a query with hpop, and add its front to the reference.

    The reference is in the folder of the graph.
    """
    query = running.add_query(graph, source, target)
    click.echo(f"{graph.stem} {source} {target}: {query['vectors']} vectors, by {' and '.join(query['checked_by'])}")


if __name__ == "__main__":
    main(prog_name="python -m hpop.benchmark")
