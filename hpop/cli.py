"""The command line: ``hpop plan``, ``show``, ``check``, ``criteria``, ``planners``.

Heavy modules are imported inside the commands, so that ``hpop --help`` answers at once. Exit codes: 0 done, 2 wrong
usage, 6 no path, 130 interrupted (what was found is kept), and those of :mod:`hpop.errors`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from hpop import __version__
from hpop.errors import CriterionError, HpopError, OutputError

NO_PATH = 6
INTERRUPTED = 130
F = TypeVar("F", bound=Callable[..., Any])


def _user_errors(command: F) -> F:
    """A user's mistake ends in one message and its exit code, never in a traceback."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> Any:
        from hpop.frontier import FrontFileError

        try:
            return command(*args, **kwargs)
        except HpopError as error:
            code, text = error.exit_code, str(error)
        except FrontFileError as error:
            code, text = OutputError.exit_code, str(error)
        except KeyboardInterrupt:
            code, text = INTERRUPTED, "interrupted before anything was found"
        click.echo(f"error: {text}", err=True)
        sys.exit(code)

    return cast(F, guarded)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="hpop")
def main() -> None:
    """Plan how a robot should move when a human watches through its camera: every optimal trade-off."""


@main.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the front and the pictures.")
@_user_errors
def plan(scenario: Path, out: Path) -> None:
    """Plan the SCENARIO (a YAML file): write front.json and pictures to a folder, and print the front."""
    from hpop import report
    from hpop.scenario import load_scenario
    from hpop.status import Status

    _make_folder(out)
    loaded = load_scenario(scenario)
    with report.progress_bar() as progress:
        front = loaded.problem.solve(loaded.planners, progress=progress)
    front.save(out / "front.json")  # before anything else can fail
    report.print_front(loaded.problem, front)
    _draw(loaded.problem, front, out)
    click.echo(f"written to {out}: {', '.join(sorted(path.name for path in out.iterdir()))}")
    if front.status == Status.NO_PATH:
        sys.exit(NO_PATH)
    if Status.INTERRUPTED in front.status:
        sys.exit(INTERRUPTED)


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@_user_errors
def show(folder: Path) -> None:
    """Print the front in a FOLDER that `hpop plan` wrote, re-evaluate its costs and check it for collisions."""
    from hpop import report
    from hpop.front import Front
    from hpop.problem import Problem
    from hpop.verify import verify

    path = folder / "front.json" if folder.is_dir() else folder
    front = Front.load(path)
    problem = Problem.from_description(front.problem or {})
    report.print_front(problem, front)
    faults = verify(problem, front)
    for fault in faults:
        click.echo(f"fault: {fault}", err=True)
    if faults:
        raise OutputError(f"{path} does not hold what it claims: {len(faults)} faults")
    click.echo(f"verified: costs re-evaluated, ends and collisions checked for {len(front)} trajectories")


@main.command()
@click.argument("criterion", metavar="MODULE:NAME")
@_user_errors
def check(criterion: str) -> None:
    """Run the conformance checks on a criterion: MODULE:NAME of its class, or a registered name."""
    from hpop.testing import conformance

    faults = 0
    made = _criterion(criterion)
    for result in conformance(made):
        faults += bool(result.fault)
        click.echo(f"{'FAIL' if result.fault else 'ok':4}  {result.claim}" + f": {result.fault}" * bool(result.fault))
    if faults:
        raise CriterionError(f"criterion {made.name!r} fails {faults} checks")


@main.command()
@_user_errors
def criteria() -> None:
    """List the criteria: group, unit, how motions add up, and what each is."""
    from hpop import report

    report.print_criteria()


@main.command()
@_user_errors
def planners() -> None:
    """List the planners and their options."""
    from hpop import report

    report.print_planners()


def _make_folder(out: Path) -> None:
    """Make sure results can be written, before hours are spent on finding them."""
    probe = out / ".hpop-write-test"
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write to {out}: {error.strerror or error}; choose another --out") from None


def _draw(problem: Any, front: Any, out: Path) -> None:
    """Pictures come last: if they fail, the front is already saved."""
    from hpop.view import save_pictures

    try:
        save_pictures(problem, front, out)
    except OSError as error:
        raise OutputError(f"the front is saved in {out}, but a picture is not: {error}") from None


def _criterion(spec: str) -> Any:
    """A criterion with its default parameters from "module:Name" or a registered name."""
    from importlib import import_module

    from hpop.criteria.base import make_criterion

    module, colon, name = spec.partition(":")
    if not colon:
        return make_criterion(spec)
    sys.path.insert(0, str(Path.cwd()))
    try:
        cls = getattr(import_module(module), name)
    except ImportError as error:
        raise CriterionError(f"cannot import {module!r}: {error}; give MODULE:NAME, seen from this folder") from None
    except AttributeError:
        raise CriterionError(f"module {module!r} has no {name!r}") from None
    try:
        return make_criterion(cls() if isinstance(cls, type) else cls)
    except TypeError as error:
        raise CriterionError(f"{spec} needs parameters without defaults ({error}); give them defaults to check it") from None
