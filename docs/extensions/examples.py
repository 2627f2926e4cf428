"""Directives for what docs/make_pictures.py made: an example with its file, a notebook with its cells, the gallery.

The code in a page is the example's file, read when the page is; what it prints and draws was made by running it. All
of it is written as Markdown, which MyST reads as it would read a page.

    ```{example} 01_museum
    ```
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from html import escape
from pathlib import Path

import make_pictures
import nbformat
from docutils import nodes
from docutils.parsers.rst import directives
from make_pictures import Recipe, small
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from extensions.repository import led

ROOT = make_pictures.ROOT
FROM_DOCS = "/../out/pictures"  # as Sphinx names what lies outside of docs/


def block(language: str, text: str) -> str:
    """Text as a block of code, whatever backticks are in it."""
    fence = "```" if "```" not in text else "``````"
    return f"{fence}{language}\n{text.strip(chr(10))}\n{fence}\n"


def figure(picture: str, caption: str, *, alt: str) -> str:
    """Return a picture as Markdown."""
    return f":::{{figure}} {picture}\n:alt: {alt}\n:class: drawn\n\n{caption}\n:::\n"


def printed(recipe: Recipe) -> str:
    """Return the output of a recipe; the browser breaks its long lines."""
    return f":::{{container}} printed\n{block('text', make_pictures.of(recipe.name)['printed'])}:::\n"


def drawn(recipe: Recipe) -> Iterator[str]:
    """Yield the pictures of a recipe that have a caption."""
    for picture, caption in recipe.captions.items():
        yield figure(f"{FROM_DOCS}/{recipe.name}/{picture}", caption, alt=caption)


class Made(SphinxDirective):
    """Directive that shows generated files."""

    required_arguments = 1

    def recipe(self) -> Recipe:
        """Return the recipe of this directive; the page is read again when the recipe has run again."""
        recipe = make_pictures.by_name()[self.arguments[0]]
        self.env.note_dependency(make_pictures.MADE / recipe.name / "made.json")
        return recipe

    def written(self, lines: Iterator[str]) -> list[nodes.Node]:
        """Lines of Markdown as a part of the page."""
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


class Example(Made):
    """An example: its file, how it is run, what it prints and draws."""

    option_spec = {"file": directives.unchanged}  # noqa: RUF012  (docutils' name)

    def run(self) -> list[nodes.Node]:
        return self.written(self.lines())

    def lines(self) -> Iterator[str]:
        """Yield the page from the code on."""
        recipe = self.recipe()
        file = self.options.get("file", f"examples/{recipe.name}.py")
        yield f"## The code\n\n{{download}}`{file} </../{file}>` is this whole file, run from a clone's root by\n"
        yield block("", recipe.command)
        yield f"```{{literalinclude}} /../{file}\n:language: {'yaml' if file.endswith('yaml') else 'python'}\n```\n"
        yield "## What it prints\n"
        yield printed(recipe)
        yield "## What it draws\n"
        yield from drawn(recipe)


class Ran(Made):
    """A command with what it prints and draws, without headings."""

    def run(self) -> list[nodes.Node]:
        recipe = self.recipe()
        return self.written(iter([block("", recipe.command), printed(recipe), *drawn(recipe)]))


class Drawn(Made):
    """Directive that shows the picture of a command alone."""

    def run(self) -> list[nodes.Node]:
        return self.written(drawn(self.recipe()))


class Live(Made):
    """A page that a command wrote, in a frame, with a link to itself: the recipe, and the page where it was written."""

    required_arguments = 2

    def run(self) -> list[nodes.Node]:
        recipe = self.recipe()
        address = "../" * self.env.docname.count("/") + recipe.live[self.arguments[1]]
        frame = (
            f'<p><a href="{address}">Open it in a page of its own</a></p>'
            f'<iframe class="live" src="{address}" title="a page that hpop wrote" loading="lazy"></iframe>'
        )
        return self.written(iter([block("{raw} html", frame)]))


def publish(app: Sphinx, failed: Exception | None) -> None:
    """Put the pages that commands wrote where the site has them."""
    if failed is None and app.builder.format == "html":
        for recipe in make_pictures.RECIPES:
            for page, place in recipe.live.items():
                target = Path(app.outdir) / place
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(make_pictures.MADE / recipe.name / page, target)


class Notebook(Made):
    """A notebook with what its cells show."""

    def run(self) -> list[nodes.Node]:
        return self.written(self.lines())

    def lines(self) -> Iterator[str]:
        """Yield the whole page."""
        recipe = self.recipe()
        file = recipe.command.split()[1]
        self.env.note_dependency(ROOT / file)
        out = make_pictures.MADE / recipe.name / "out"
        outputs = iter(json.loads((out / "outputs.json").read_text(encoding="utf-8")))
        begun = False
        for cell in nbformat.read(ROOT / file, as_version=4).cells:
            if cell.cell_type == "markdown":
                yield led(cell.source, str(Path(file).parent), file) + "\n"
                if not begun:
                    yield f"This page is {{download}}`{file} </../{file}>`, run from its first cell to its last.\n"
                begun = True
                continue
            yield block("python", cell.source)
            for output in next(outputs):
                if "picture" in output:
                    yield f"![what the cell shows]({FROM_DOCS}/{recipe.name}/out/{output['picture']}){{.drawn}}\n"
                elif "html" in output:
                    yield block("{raw} html", f'<div class="output">{output["html"]}</div>')
                else:
                    yield block("text", output["text"])


class Gallery(SphinxDirective):
    """All pictures that have a caption, each a link to the page with the code or the command that made it."""

    def run(self) -> list[nodes.Node]:
        grid = nodes.container(classes=["gallery"])
        for recipe in make_pictures.RECIPES:
            self.env.note_dependency(make_pictures.MADE / recipe.name / "made.json")
            docname, _, place = recipe.page.partition("#")
            page = self.env.app.builder.get_relative_uri(self.env.docname, docname) + (place and f"#{place}")
            for picture, caption in recipe.captions.items():
                image = nodes.image(uri=f"{FROM_DOCS}/{recipe.name}/{small(picture)}", alt=caption)
                link = nodes.reference("", "", image, internal=True, refuri=page, reftitle=recipe.command)
                words = nodes.caption("", "", *self.parse_inline(f"{caption}: `{escape(recipe.command)}`")[0])
                grid += nodes.figure("", link, words, classes=["thumbnail"])
        return [grid]


def setup(app: Sphinx) -> dict[str, bool]:
    """Know the directives."""
    app.add_directive("example", Example)
    app.add_directive("ran", Ran)
    app.add_directive("drawn", Drawn)
    app.add_directive("notebook", Notebook)
    app.add_directive("gallery", Gallery)
    app.add_directive("live", Live)
    app.connect("build-finished", publish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
