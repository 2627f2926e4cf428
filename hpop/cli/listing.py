"""Commands before planning: lists of plugins and words, ``hpop look``, and ``hpop new``, which writes a scenario."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

import hpop
from hpop import cli
from hpop.base.text import argument, shown
from hpop.cli import results
from hpop.cli.terminal import NO_PATH, NOTHING_FOUND, echo, imports_option, open_page, user_errors
from hpop.errors import OptionError, OutputError, QueryError
from hpop.runtime.limits import Status

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.scenario.new import Draft, GivenMap


@click.command()
@imports_option
@user_errors
def criteria(imports: tuple[str, ...]) -> None:
    """List the criteria, with units and meaning.

    Each has its group, its unit, and the rule by which the costs of motions add up.
    """
    cli.user_code.register(imports)
    cli.explain.print_criteria()


@click.command()
@imports_option
@user_errors
def models(imports: tuple[str, ...]) -> None:
    """List the robots, with parameters and meaning.

    Each line also says what the robot provides to criteria and planners.
    """
    cli.user_code.register(imports)
    cli.explain.print_models()


@click.command()
@imports_option
@user_errors
def goals(imports: tuple[str, ...]) -> None:
    """List the goals other than a single state, with their parameters."""
    cli.user_code.register(imports)
    cli.explain.print_goals()


@click.command()
@imports_option
@user_errors
def planners(imports: tuple[str, ...]) -> None:
    """List the planners and their options."""
    cli.user_code.register(imports)
    cli.explain.print_planners()


@click.command()
@imports_option
@user_errors
def formats(imports: tuple[str, ...]) -> None:
    """List the formats of `hpop export`, with endings and axes."""
    cli.user_code.register(imports)
    cli.explain.print_formats()


@click.command()
@click.argument("word", required=False, metavar="[WORD|FOLDER]")
@click.option(
    "--through",
    metavar="PLACE",
    help='Why no path passes there: "left of NAME", "between NAME and NAME", a zone, x,y, or corners x,y x,y x,y.',
)
@click.option(
    "--wish", metavar="WISH", help='Why no path has less of a cost: "fewer turns", hurry, or a bound, turns=3.'
)
@click.option("--than", metavar="ROW", help="Row of the front to compare with, by number or name.")
@imports_option
@user_errors
def explain(
    word: str | None, through: str | None, wish: str | None, than: str | None, imports: tuple[str, ...]
) -> None:
    """Explain a printed word, or why no path of a front passes somewhere.

    A WORD may also be the name of a criterion, planner, robot, goal, reader or export format. Without a WORD, all words
    with an explanation are listed. With --through or --wish, FOLDER holds the front that `hpop plan` wrote.
    """
    cli.user_code.register(imports)
    if through is not None or wish is not None:
        if word is None:
            raise click.UsageError("--through and --wish need the FOLDER of a front, which `hpop plan` wrote")
        cli.explain.print_why(Path(word), through, wish, than)
        return
    if than is not None:
        raise click.UsageError("--than needs --through or --wish: what shall be compared with the row")
    echo(cli.explain.known() if word is None else cli.explain.explained(word))


@click.command()
@imports_option
@user_errors
def schema(imports: tuple[str, ...]) -> None:
    """Print the JSON schema of scenarios.

    Editors use it to complete and check scenarios. Write it to a file, and name the file in the first line of a
    scenario: # yaml-language-server: $schema=FILE
    """
    cli.user_code.register(imports)
    json_schema = hpop.scenario.json_schema
    echo(json_schema.written(json_schema.scenario_schema()).rstrip())


COMMANDS = (criteria, models, goals, planners, formats, explain, schema)


DPI = 150
URDF = ".urdf"


def _pairs(context: click.Context, option: click.Parameter, given: Sequence[str]) -> dict[str, str]:
    """Parse the values NAME=VALUE of a repeated option into a dictionary of texts."""
    texts = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise click.BadParameter(f"expected NAME=VALUE, such as polygons=outline, got {text!r}", context, option)
        texts[name.strip()] = value
    return texts


def _map_options(command: Any) -> Any:
    """Add the options that describe a map file and the robot's radius to a command."""
    for option in (
        click.option("--radius", type=float, metavar="M", help="Radius of the robot, m; 0.3 by default."),
        click.option("--reader", metavar="NAME", help="Reader of the map, if the file's ending does not decide it."),
        click.option(
            "--set",
            "options",
            multiple=True,
            metavar="NAME=VALUE",
            callback=_pairs,
            help="Option of the reader, such as polygons=outline; `hpop explain geojson` lists them. Repeatable.",
        ),
        click.option(
            "--resolution", type=float, metavar="M", help="Metres per pixel of an image, or per unit of a drawing."
        ),
    ):
        command = option(command)
    return command


@click.command()
@click.argument("path", metavar="MAP|SCENARIO|URDF", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), metavar="PNG|HTML", help="[NAME_look.png, NAME_look.html]")
@click.option("--web", is_flag=True, help="For an arm, write NAME_look.html too, a page to move its joints.")
@click.option("--open", "opens", is_flag=True, help="Write this page and open it in a browser.")
@_map_options
@imports_option
@user_errors
def look(
    path: Path,
    out: Path | None,
    web: bool,
    opens: bool,
    resolution: float | None,
    options: dict[str, str],
    reader: str | None,
    radius: float | None,
    imports: tuple[str, ...],
) -> None:
    """Draw a map, scenario or arm, before planning.

    The picture, in metres, shows free space, start, goal, people, landmarks and zones. For an arm, a second picture
    shows it from the side, with heights; _side is added to its name. With --web, a page shows an arm among its
    obstacles, with joints to move, and names the bodies that collide. If the start or goal is blocked, the nearest free
    position is printed (exit code 5). If no path leads from the start to a goal, that is printed too (exit code 6). For
    a MAP, start and goal are those that `hpop new` would try first. An earlier picture of this name is replaced. For a
    URDF, only the page is written, and --set gives parameters of the model serial_arm, such as tip=tool. By default,
    the tip is at the end of the longest chain of joints.
    """
    cli.user_code.register(imports)
    if path.suffix.lower() == URDF:
        _look_at_urdf(path, out, options, opens=opens)
        return
    if out is not None and out.suffix.lower() != ".png":
        raise OutputError(f"--out: expected a name that ends in .png, got {shown(str(out))}; the picture is a PNG file")
    from hpop.view.look import look as looked

    given: GivenMap | None = None
    if reader is None and hpop.scenario.new.is_scenario(path):
        if options or resolution is not None or radius is not None:
            raise click.UsageError(
                f"--set, --resolution and --radius describe a map, but {path} is a scenario, which has its own "
                "values: leave the options out, or change the scenario"
            )
        problem = hpop.scenario.load_scenario(path).problem
    else:
        new = hpop.scenario.new
        given = new.GivenMap.of(path, reader, resolution, new.checked_options(options))
        problem = cast("Problem", new.first_problem(given.read(), radius))
    out = Path(f"{path.stem}_look.png") if out is None else out
    replaced = " (replaced)" if out.exists() else ""
    if replaced and out.samefile(path):
        raise OutputError(f"--out: expected another name than that of the map, got {out}, which it would replace")
    page = hpop.view.save_arm_page(problem, out.with_suffix(".html")) if web or opens else None
    seen = looked(problem, f"{path.name}: {_size(problem)}")
    with results.output_errors(f"cannot write {out}", "choose another --out"):
        hpop.view.save.save_figure(seen.figure, out, DPI)
        side = None if seen.side is None else out.with_stem(f"{out.stem}_side")
        if seen.side is not None and side is not None:
            hpop.view.save.save_figure(seen.side, side, DPI)
    for note in (*problem.world.notes, *problem.notes, *seen.notes):
        _say(note, given)
    echo(f"written to {out}{replaced}" + ("" if side is None else f", and the view from the side to {side}"))
    if page is not None:
        _say_page(page, opens=opens)
    elif side is not None and "joints" in problem.model.provides:
        echo(f"to move its joints in a browser: hpop look {argument(path)} --web")
    if seen.refused:
        raise QueryError("\n".join(seen.refused))
    if seen.no_way:
        echo("error: no path seems to lead from the start to a goal; the picture shows the reached area", err=True)
        sys.exit(NO_PATH)


def _say_page(page: Path, *, opens: bool) -> None:
    echo(f"written: {page}, to move the arm's joints in a browser and see what collides")
    if opens:
        open_page(page)


def _look_at_urdf(path: Path, out: Path | None, options: dict[str, str], *, opens: bool) -> None:
    """Write the page of the arm in a URDF file; values of options are YAML, such as fixed={finger: 0.04}."""
    import yaml

    from hpop.models.serial_arm.model import SerialArm
    from hpop.models.serial_arm.urdf import read_urdf

    try:
        given = {name: yaml.safe_load(text) for name, text in options.items()}
    except yaml.YAMLError as error:
        raise OptionError(f"--set: values are YAML, such as fixed={{finger: 0.04}}; {error}") from None
    if "tip" not in given:
        given["tip"] = read_urdf(path).farthest_tip
        echo(f"note: the tip is {given['tip']}, at the end of the most joints; --set tip=NAME chooses another link")
    arm = SerialArm.from_urdf(path, **{"acceleration": 1.0, **given})  # without effect on the page
    for note in arm.notes:
        echo(f"note: {note}")
    _say_page(hpop.view.save_arm_page(arm, Path(f"{path.stem}_look.html") if out is None else out), opens=opens)


@click.command()
@click.argument("path", metavar="MAP", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), metavar="YAML", help="[NAME_scenario.yaml]")
@click.option("--start", metavar="X,Y[,HEADING]", help="Start of the robot, m; far from the goal by default.")
@click.option("--goal", metavar="X,Y[,HEADING]", help="Goal of the robot, m; far from the start by default.")
@_map_options
@imports_option
@user_errors
def new(
    path: Path,
    out: Path | None,
    start: str | None,
    goal: str | None,
    resolution: float | None,
    options: dict[str, str],
    reader: str | None,
    radius: float | None,
    imports: tuple[str, ...],
) -> None:
    """Write a first scenario for a map.

    The scenario has comments, and can be planned as it is. If no path is found, the exit code is 6, or 13 if the time
    ran out. The schema for editors is written beside it. A MAP is an image, GeoJSON, DXF, PDF, a ROS map or bag, a
    MovingAI grid, or a file for a reader of your own.
    """
    cli.user_code.register(imports)
    scenarios = hpop.scenario.new
    file = Path(f"{path.stem}_scenario.yaml") if out is None else out
    if file.exists():
        raise OutputError(f"{file} exists; remove it, or choose another --out")
    if reader is None and scenarios.is_scenario(path):
        shell = argument(path)
        raise OptionError(
            f"expected a map, but {path} is a scenario already: hpop look {shell} draws it and hpop plan {shell} plans "
            "it; for a new scenario give its map"
        )
    given = scenarios.GivenMap.of(path, reader, resolution, scenarios.checked_options(options))
    draft = scenarios.first_draft(given.read(), radius, start, goal)
    problem = draft.problem
    _write(file, given, draft, chosen=start is None and goal is None)
    for note in problem.world.notes:
        _say(note, given)
    echo(f"written: {file}, and its schema for editors, {file.with_name(scenarios.SCHEMA)}")
    shell, folder = argument(file), argument(Path("out", file.stem))
    if draft.status is None:
        echo(f"the map is {_size(problem)}; next: hpop look {shell}, then hpop plan {shell} --out {folder}")
        return
    status, why = draft.status
    closed = status == Status.NO_PATH
    echo(f"the map is {_size(problem)}; hpop look {shell} shows where the robot is free")
    found = "no path was found" if closed else f"no path was found within {scenarios.LONGEST:g} s"
    way_out = "move start or goal (--start, --goal), or take a smaller robot (--radius)"
    if not closed:
        way_out = f"hpop plan {shell} may find one in more time; or {way_out}"
    echo(f"error: {found} from the start to the goal: {why}; {way_out}", err=True)
    sys.exit(NO_PATH if closed else NOTHING_FOUND)


def _write(file: Path, given: GivenMap, draft: Draft, *, chosen: bool) -> None:
    """Write a scenario and its schema to files; remove the scenario again if it cannot be loaded.

    ``chosen`` says that hpop, not the user, chose start and goal.
    """
    json_schema, new = hpop.scenario.json_schema, hpop.scenario.new
    text = new.scenario_text(given, draft, file.parent, file.name, chosen=chosen)
    with results.output_errors(f"cannot write {file}", "choose another --out"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        file.with_name(new.SCHEMA).write_text(json_schema.written(json_schema.scenario_schema()), encoding="utf-8")
    try:
        hpop.scenario.load_scenario(file)
    except Exception:
        file.unlink()
        raise


def _say(note: str, given: GivenMap | None) -> None:
    """Print a note; if the map came from the command line, also options for it that the note proposes."""
    options = "" if given is None else given.proposed(note)
    echo(f"note: {note}" + (f"{'' if note.endswith('.') else '.'} Here: {options}" if options else ""))


def _size(problem: Problem) -> str:
    x0, y0, x1, y1 = problem.world.bounds
    return f"{x1 - x0:.4g} x {y1 - y0:.4g} m"
