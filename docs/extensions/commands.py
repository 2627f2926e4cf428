"""The directive ``commands``: every command of hpop with its arguments and options, read from the commands."""

from __future__ import annotations

import re
from collections.abc import Iterator

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from hpop.cli import main


def cell(text: str) -> str:
    """Text in a table of Markdown."""
    return re.sub(r"\s+", " ", text).replace("|", r"\|")


def form(option: click.Option, context: click.Context) -> str:
    """Return an option as its help writes it."""
    record = option.get_help_record(context)
    return record[0] if record else ", ".join(option.opts)


def described(name: str, command: click.Command) -> Iterator[str]:
    """One command as Markdown."""
    context = click.Context(command, info_name=f"hpop {name}")
    yield f"## `hpop {name}`\n"
    yield "```text\n" + " ".join(["hpop", name, *command.collect_usage_pieces(context)]) + "\n```\n"
    for paragraph in (command.help or "").replace("\b\n", "").split("\n\n"):
        yield re.sub(r"([*_<])", r"\\\1", re.sub(r"\s+", " ", paragraph)) + "\n"
    options = [option for option in command.params if isinstance(option, click.Option) and not option.hidden]
    if options:
        yield "| option | |\n|---|---|"
        for option in options:
            yield f"| `{cell(form(option, context))}` | {cell(option.help or '')} |"
        yield ""


class Commands(SphinxDirective):
    """All commands, in alphabetical order, and those that are parts of one after it."""

    def run(self) -> list[nodes.Node]:
        context = click.Context(main)
        lines: list[str] = []
        for name in main.list_commands(context):
            command = main.get_command(context, name)
            if command is not None and not command.hidden:
                lines += described(name, command)
                several = command.commands if isinstance(command, click.Group) else {}
                for part in sorted(several):
                    lines += described(f"{name} {part}", several[part])
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Know the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
