"""Command ``python -m hpop.benchmark``: run a program on instances, solve one with hpop, convert files of others."""

from __future__ import annotations

from pathlib import Path

import click

from hpop.benchmark import graph_files, reference, running
from hpop.errors import HpopError
from hpop.runtime.status import Budget
from hpop.search import pareto_paths

FILE = click.Path(path_type=Path, dir_okay=False)


class _Group(click.Group):
    """Group of commands that print errors of hpop as one line, and end with their exit codes."""

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
@click.option("--instances", type=click.Path(path_type=Path), required=True, help="Folder of benchmarks/open/make.py.")
@click.option("--only", multiple=True, metavar="NAME", help="Instance to run; may be repeated. [default: all]")
@click.option("--time-limit", type=float, default=300.0, show_default=True, help="Seconds for one query.")
@click.option("--first-node", type=click.IntRange(0, 1), default=1, show_default=True, help="Number of the first node.")
@click.option("--count", default="", help="Pattern of the number of vectors, if the program prints no vectors.")
@click.option("--clock", default="", help="Pattern of the program's own seconds in its output.")
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

    The program prints one cost vector a line on standard output. {graph} is a file, {graphs} one file a cost, {source}
    and {target} are nodes, {costs} is the number of costs. The exit code is 1 if a front differs.
    """
    program = running.ForeignProgram(binary, first_node, count, clock)
    results = []
    for result in running.run_program(program, reference.read_queries(instances, only), time_limit):
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
    """Print the exact front of a query, one vector a line, and the seconds of the search in a comment."""
    read = graph_files.read_graph(graph)
    pareto_paths(read, source - 1, target - 1, method=method, budget=Budget(max_labels=1))  # loads the kernels
    paths = pareto_paths(read, source - 1, target - 1, method=method)
    for vector in paths.costs.tolist():
        click.echo(" ".join(map(str, vector)))
    click.echo(f"c seconds {paths.stats.seconds_bounds + paths.stats.seconds_search:.6f}")


@main.command()
@click.argument("form", type=click.Choice(list(graph_files.READERS)))
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.argument("out", type=FILE)
@click.option("--cost", multiple=True, metavar="COLUMN", help="Cost of tntp: a column, or a ratio of two.")
def convert(form: str, files: tuple[Path, ...], out: Path, cost: tuple[str, ...]) -> None:
    """Convert files of another format: several for dimacs, one for each cost; one file for all others."""
    if form != "dimacs" and len(files) != 1:
        raise click.UsageError(f"{form} takes one file, got {len(files)}")
    if cost and form != "tntp":
        raise click.UsageError("--cost is an option of tntp; files of other formats have all costs of an arc")
    graph = graph_files.read_tntp(files, cost) if cost else graph_files.READERS[form](files)
    graph_files.write_graph(graph, out)
    click.echo(f"{out}: {graph.nodes} nodes, {graph.arcs} arcs, {graph.criteria} costs")


@main.command()
@click.argument("graph", type=FILE)
@click.argument("source", type=int)
@click.argument("target", type=int)
def add(graph: Path, source: int, target: int) -> None:
    """Solve a query of a graph with hpop, and add its front to the reference in the graph's folder."""
    query = reference.add_query(graph, source, target)
    click.echo(f"{graph.stem} {source} {target}: {query['vectors']} vectors, by {' and '.join(query['checked_by'])}")


if __name__ == "__main__":
    main(prog_name="python -m hpop.benchmark")
