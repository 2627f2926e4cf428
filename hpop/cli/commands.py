"""Main command ``hpop``, with ``hpop plan``, ``demo`` and ``check``; the other commands are in modules beside this one.

Exit codes: 0 done, 2 wrong usage, 6 no path, 13 a limit was reached before the map was read or a path was found, 130
interrupted by Ctrl-C, SIGTERM or SIGHUP (results so far are kept), and those of :mod:`hpop.errors`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

import hpop
from hpop import __version__, cli, examples, runtime
from hpop.base.options import MOST_WORKERS
from hpop.base.text import argument
from hpop.cli import listing, results
from hpop.cli.beside import LivePage, PicturesBeside, kernels_beside
from hpop.cli.exporting import export, ride
from hpop.cli.listing import look, new
from hpop.cli.living import live
from hpop.cli.preferring import prefer
from hpop.cli.results import SAVED
from hpop.cli.robots import ros
from hpop.cli.running import batch, drive
from hpop.cli.saved import pick, retime, show
from hpop.cli.studying import study
from hpop.cli.terminal import (
    INTERRUPTED,
    NO_PATH,
    NOTHING_FOUND,
    Commands,
    echo,
    imports_option,
    points_option,
    user_errors,
    verbose_option,
)
from hpop.errors import OptionError, OutputError
from hpop.runtime import limits
from hpop.runtime.interrupts import stopping_announced
from hpop.runtime.limits import Status

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from hpop.planners import Planner
    from hpop.problems.front import Front
    from hpop.scenario import Scenario

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

MOST_PORT = 65_535
LIVE = "live"
"""Example that ``hpop demo`` serves as ``hpop live`` does."""
# NumPy starts an OpenBLAS thread for each further core, which spins for 2**26 cycles (25 ms) before it sleeps. 2**20
# cycles suffice to bridge the pause between two products of large matrices.
SPIN = "20"
COLLISIONS = "compiling collision checks first: about 20 s, once on each machine, not counted in any time limit"
COMPILING = "the search is compiled in the background {}, once for each number and kind of costs"


def _folder(context: click.Context, option: click.Parameter, given: str | None) -> Path | None:
    """Convert the value of a folder option to a path, None to None; refuse "", which an unset shell variable gives."""
    if given == "":
        raise click.BadParameter("expected a folder, got ''; the current folder is '.'", context, option)
    return None if given is None else Path(given)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="hpop")
def main() -> None:
    """Plan how a robot should move when a human watches through its camera: every optimal trade-off."""
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", SPIN)  # read as NumPy is imported


@main.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option(
    "--out", callback=_folder, help="Folder for the front and the pictures; out/SCENARIO by default.", metavar="PATH"
)
@click.option(
    "--workers", type=click.IntRange(1, MOST_WORKERS), help="Processes for planners of many runs, such as weighted-sum."
)
@click.option("--dask", metavar="ADDRESS", help="Dask scheduler for these planners, such as tcp://host:8786.")
@click.option(
    "--checkpoint",
    metavar="FILE",
    help="File that saves the progress of an exact search. Give it again to continue after Ctrl-C, a limit or kill -9.",
)
@click.option(
    "--web",
    "port",
    type=click.IntRange(0, MOST_PORT),
    metavar="PORT",
    help="Show results in a browser while the search runs, on this machine only. 0 takes any free port.",
)
@points_option("Keep only N trajectories that represent the front (largest hypervolume); all by default.")
@verbose_option
@imports_option
@user_errors
def plan(
    scenario: Path,
    out: Path | None,
    workers: int | None,
    dask: str | None,
    checkpoint: str | None,
    port: int | None,
    points: int | None,
    verbose: bool,
    imports: tuple[str, ...],
) -> None:
    """Plan a scenario: compute its front and draw pictures.

    Reads the SCENARIO (a YAML file), writes front.json and pictures to the folder --out, and prints the front. No
    option is required.
    """
    if workers is not None and dask is not None:
        raise click.UsageError("give --workers or --dask, not both")
    runtime.interrupts.collect_rarely()
    from hpop.motions import collision_of
    from hpop.planners.base import sweeps
    from hpop.search.machinery.beside import Onset

    cli.user_code.register(imports)
    loaded = hpop.scenario.load_scenario(scenario)
    out = out or Path("out", scenario.stem)
    results.check_writable(out)
    click.get_current_context().with_resource(results.held(out))
    if (workers or dask) and not any(map(sweeps, loaded.planners)):
        names = ", ".join(planner.name for planner in loaded.planners)
        echo(f"note: one process does all the work: no planner of the scenario ({names}) can use several", err=True)
    if checkpoint is not None:
        loaded = replace(loaded, planners=_keeping(loaded.planners, checkpoint))
        if Path(checkpoint).exists():
            echo(f"continuing from {checkpoint}")
    live = None if port is None else click.get_current_context().with_resource(LivePage(port, out, imports))
    if live is not None:
        missing = "note: --web: the process that serves the page could not be started; the search runs without it"
        echo(f"results of the running search: {live.address}" if live.is_served else missing, err=True)
    # Until the command ends: kernels for the next plan are compiled while this plan's pictures are drawn.
    onset = click.get_current_context().with_resource(kernels_beside(loaded.planners, loaded.problem))
    if onset is not None:
        echo(COMPILING.format(onset), err=True)
    model, world = loaded.problem.model, loaded.problem.world
    if "joints" in model.provides and collision_of(model, world).is_uncompiled:
        echo(COLLISIONS, err=True)
    with _executor(workers, dask) as executor, stopping_announced():
        fronts = _solved(loaded, out, executor, imports, live, waits=onset is Onset.AFTER_FIRST)
    front = fronts[-1]
    try:
        if points is not None and points < len(front):
            front = front.representative(points)
            results.save(front, out)
        options: dict[str, Any] = {"saved": out / SAVED, "verbose": verbose, "preference": loaded.preference}
        cli.report.print_front(loaded.problem, front, **options)
        if loaded.preference is not None and len(front):
            cli.picking.print_preference(loaded.preference, front)
        cli.report.print_contributions([planner.name for planner in loaded.planners], fronts)
        if checkpoint is not None:
            _tidy(checkpoint, front)
        _draw(loaded, front, out, imports)
    except KeyboardInterrupt:  # the results so far are saved
        what = "complete and saved" if cli.report.is_complete(front) else "saved"
        advice = f"pictures are missing; `hpop show {argument(out)}` prints the front"
        echo(f"interrupted: the front is {what} in {out / SAVED}; {advice}", err=True)
        sys.exit(INTERRUPTED)
    if front.status == Status.NO_PATH:
        sys.exit(NO_PATH)
    if Status.INTERRUPTED in front.status:
        sys.exit(INTERRUPTED)
    if not len(front):
        echo(f"error: nothing was found: {cli.report.why_nothing(front.status)}", err=True)
        sys.exit(NOTHING_FOUND)


@main.command()
@click.argument("name", type=click.Choice(sorted(examples.SCENARIOS)), default="museum")
@click.option("--out", callback=_folder, help="Folder for all of it; out/NAME by default.", metavar="PATH")
@click.pass_context
@user_errors
def demo(context: click.Context, name: str, out: Path | None) -> None:
    """Plan an example that comes with hpop; the example live is driven in a browser instead.

    NAME is the example, by default the museum tour. Its scenario and map are copied to the folder, so that you can
    change them and plan again.
    """
    out = out or Path("out", name)
    scenario = examples.copied(name, out)
    if name == LIVE:
        echo(f"`hpop live {argument(scenario)}` serves it again")
        context.invoke(live, scenario=scenario, out=out)
        return
    echo(f"planning {scenario}: change it, and `hpop plan {argument(scenario)} --out {argument(out)}` plans it again")
    context.invoke(plan, scenario=scenario, out=out)


main.add_command(show)
main.add_command(batch)
main.add_command(pick)
main.add_command(prefer)
main.add_command(ride)
main.add_command(drive)
main.add_command(live)
main.add_command(export)
main.add_command(retime)
main.add_command(ros)
main.add_command(look)
main.add_command(new)
main.add_command(study)
for each in listing.COMMANDS:
    main.add_command(each)


@main.command()
@click.argument("plugin", metavar="NAME")
@imports_option
@user_errors
def check(plugin: str, imports: tuple[str, ...]) -> None:
    """Run the conformance checks on a criterion, model or planner.

    NAME is FILE.py:NAME or MODULE:NAME of its class, or its registered name.
    """
    cli.user_code.register(imports)
    faults = 0
    made = cli.user_code.named(plugin)
    for result in hpop.testing.conformance(made):
        faults += bool(result.fault)
        echo(f"{'FAIL' if result.fault else 'ok':4}  {result.claim}" + f": {result.fault}" * bool(result.fault))
    if faults:
        registry = hpop.testing.kind_of(made)
        called = getattr(made, "name", type(made).__name__)
        raise registry.error(f"{registry.kind} {called!r} fails {faults} check{'s' * (faults > 1)}")


@contextmanager
def _executor(workers: int | None, dask: str | None) -> Iterator[Executor | None]:
    """Yield the executor for planners that make many independent runs: processes, a Dask cluster, or None.

    With None, this process does all the work.
    """
    if dask is not None:
        with runtime.sweep.dask(dask) as cluster:
            yield cluster
    elif workers is not None and workers > 1:
        try:
            pool = runtime.sweep.processes(workers)
        except OptionError as error:
            echo(f"note: --workers: {error}: this process does all the work", err=True)
            yield None
            return
        with pool:
            yield pool
    else:
        yield None


def _solved(
    scenario: Scenario,
    out: Path,
    executor: Executor | None,
    imports: Sequence[str],
    live: LivePage | None,
    *,
    waits: bool,
) -> list[Front]:
    """Run the planners of a scenario in turn; return the joint front after each. Each front is saved at once.

    Intermediate fronts of a planner (its stages) are saved too. If no newer front follows soon, another process draws
    the map of an intermediate front. If the search must wait until its kernels are compiled (``waits``), this process
    draws the first map meanwhile: this is twice as fast, and imports the libraries that the last pictures need.
    """
    fronts: list[Front] = []
    say = cli.report.StageLines()
    with limits.progress_bar() as progress, PicturesBeside(out, imports, _most(scenario)) as pictures:

        def keep(front: Front) -> None:
            pictures.stop()
            results.save(front, out)
            if live is not None:
                live.saved()
            say(front)

        def stage(front: Front) -> None:
            is_first = say.last is None
            keep(front)
            if waits and is_first:
                with suppress(OutputError):  # an error that persists is reported with the last pictures
                    results.draw(scenario.problem, front, out, map_alone=True, max_memory=_most(scenario))
            else:
                pictures.stage()

        try:
            for front in scenario.problem.fronts(scenario.planners, progress=progress, executor=executor, stage=stage):
                try:
                    keep(front)
                except KeyboardInterrupt:  # a second Ctrl-C ends at once
                    keep(front)
                    fronts.append(front)
                    raise
                fronts.append(front)
        except (Exception, KeyboardInterrupt):
            if say.last is not None:
                echo(f"the front found before is saved in {out / SAVED}", err=True)
            raise
    return fronts


def _draw(scenario: Scenario, front: Front, out: Path, imports: Sequence[str]) -> None:
    """Draw the pictures. After an interrupted search another process draws them, so that the prompt returns at once."""
    if Status.INTERRUPTED in front.status:
        PicturesBeside(out, imports, _most(scenario)).start()
        echo(f"written to {out}: {SAVED}; pictures are being drawn in the background")
    else:
        most = _most(scenario)
        drawn = results.draw(scenario.problem, front, out, max_memory=most, preference=scenario.preference)
        echo(f"written to {out}: {', '.join([SAVED, *drawn])}")


def _most(scenario: Scenario) -> int | None:
    """Return the memory limit for drawing, bytes: the largest of the planners' limits; None if one has no limit."""
    from hpop.planners.spending import common_spending

    return common_spending(scenario.planners).limits.max_memory


def _keeping(chosen: Sequence[Planner], checkpoint: str) -> tuple[Planner, ...]:
    """Return the planners, with the only exact search among them set to save its progress in the file ``checkpoint``.

    Raises OptionError if none or several of the planners can save their search.
    """
    from hpop.base.registry import planners

    def saves_search(planner: Any) -> bool:
        return "checkpoint" in {option.name for option in fields(planner)}

    keeping = [planner for planner in chosen if saves_search(planner)]
    if len(keeping) != 1:
        able = [name for name, cls in planners.items() if saves_search(cls)]
        raise OptionError(
            f"--checkpoint saves the search of exactly one of these planners: {', '.join(able)}; the scenario has "
            f"{', '.join(planner.name for planner in chosen)}; "
            + ("leave only one of them in it" if keeping else "leave out --checkpoint, or change the planner")
        )
    hpop.search.Checkpoint(checkpoint).checked_path()
    kept: Any = replace(cast(Any, keeping[0]), checkpoint=checkpoint)
    return tuple(kept if planner is keeping[0] else planner for planner in chosen)


def _tidy(checkpoint: str, front: Front) -> None:
    """Remove the checkpoint file if the front is complete; otherwise print how to continue the search."""
    file = Path(checkpoint).resolve()
    if cli.report.is_complete(front):
        with results.output_errors(f"cannot remove the checkpoint {file}", "it is no longer needed"):
            file.unlink(missing_ok=True)
    elif file.exists():
        echo(f"the search is saved in {checkpoint}: plan again with --checkpoint {argument(checkpoint)} to continue")
