"""Commands that list plugins (``hpop criteria``, ``models``, ``planners``, ...), explain words, or print the schema."""

from __future__ import annotations

import click

from hpop.cli.terminal import echo, imports_option, user_errors

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.


@click.command()
@imports_option
@user_errors
def criteria(imports: tuple[str, ...]) -> None:
    """List the criteria, with units and meaning.

    Each has its group, its unit, and the rule by which the costs of motions add up.
    """
    from hpop.cli import explain, user_code

    user_code.register(imports)
    explain.print_criteria()


@click.command()
@imports_option
@user_errors
def models(imports: tuple[str, ...]) -> None:
    """List the robots, with parameters and meaning.

    Each line also says what the robot provides to criteria and planners.
    """
    from hpop.cli import explain, user_code

    user_code.register(imports)
    explain.print_models()


@click.command()
@imports_option
@user_errors
def goals(imports: tuple[str, ...]) -> None:
    """List the goals other than a single state, with their parameters."""
    from hpop.cli import explain, user_code

    user_code.register(imports)
    explain.print_goals()


@click.command()
@imports_option
@user_errors
def planners(imports: tuple[str, ...]) -> None:
    """List the planners and their options."""
    from hpop.cli import explain, user_code

    user_code.register(imports)
    explain.print_planners()


@click.command()
@imports_option
@user_errors
def formats(imports: tuple[str, ...]) -> None:
    """List the formats of `hpop export`, with endings and axes."""
    from hpop.cli import explain, user_code

    user_code.register(imports)
    explain.print_formats()


@click.command()
@click.argument("word", required=False)
@imports_option
@user_errors
def explain(word: str | None, imports: tuple[str, ...]) -> None:
    """Explain a printed word.

    A WORD may also be the name of a criterion, planner, robot, goal, reader or export format. Without a WORD, all words
    with an explanation are listed.
    """
    from hpop.cli import user_code
    from hpop.cli.explain import explained, known

    user_code.register(imports)
    echo(known() if word is None else explained(word))


@click.command()
@imports_option
@user_errors
def schema(imports: tuple[str, ...]) -> None:
    """Print the JSON schema of scenarios.

    Editors use it to complete and check scenarios. Write it to a file, and name the file in the first line of a
    scenario: # yaml-language-server: $schema=FILE
    """
    from hpop.cli import user_code
    from hpop.scenario import json_schema

    user_code.register(imports)
    echo(json_schema.written(json_schema.scenario_schema()).rstrip())


COMMANDS = (criteria, models, goals, planners, formats, explain, schema)
