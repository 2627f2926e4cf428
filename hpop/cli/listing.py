"""Commands that list plugins (``hpop criteria``, ``models``, ``planners``, ...), explain words, or print the schema."""

from __future__ import annotations

import click

import hpop
from hpop import cli
from hpop.cli.terminal import echo, imports_option, user_errors


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
@click.argument("word", required=False)
@imports_option
@user_errors
def explain(word: str | None, imports: tuple[str, ...]) -> None:
    """Explain a printed word.

    A WORD may also be the name of a criterion, planner, robot, goal, reader or export format. Without a WORD, all words
    with an explanation are listed.
    """
    cli.user_code.register(imports)
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
