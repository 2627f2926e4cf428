"""Links of the repository, which lead somewhere in a clone, lead to the site's page of the same thing.

The pages of docs/ and README, CHANGELOG and CONTRIBUTING, which the site includes, name files relative to where they
lie. What has a page of its own is linked there; what has none and is not in docs/ is an error of the build, so that a
reader is never led off the site into nothing.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

log = logging.getLogger(__name__)
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#|/)([^)#\s]+)(#[^)\s]*)?(?=\))")

#: What lies outside of docs/, and the site's page of it. Examples have theirs by name.
PAGES = {
    "README.md": "overview.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CITATION.cff": "cite.md",
    "examples": "tutorials/index.md",
    "examples/notebooks": "tutorials/index.md#notebooks",
    "examples/plugin": "tutorials/plugin.md",
    "examples/plugin/README.md": "tutorials/plugin.md",
}
EXAMPLE = re.compile(r"examples/(notebooks/)?(\w+)\.(?:py|ipynb)")


def page_of(file: str) -> str | None:
    """Return the page, seen from docs/, of a file or folder of the repository; None if the site has none.

    >>> page_of("docs/front.md"), page_of("examples/01_museum.py"), page_of("examples/notebooks/04_own_graph.ipynb")
    ('front.md', 'tutorials/01_museum.md', 'tutorials/notebook_04_own_graph.md')
    """
    if file.startswith("docs/"):
        return file.removeprefix("docs/")
    if example := EXAMPLE.fullmatch(file):
        return f"tutorials/{'notebook_' if example[1] else ''}{example[2]}.md"
    return PAGES.get(file)


def led(text: str, folder: str, file: str) -> str:
    """Markdown of a file in a folder of the repository, its links as the site has them.

    >>> led("[first](../README.md#to-begin), [knee](#the-knee), [paper](https://arxiv.org)", "docs", "front.md")
    '[first](/overview.md#to-begin), [knee](#the-knee), [paper](https://arxiv.org)'
    """

    def lead(link: re.Match[str]) -> str:
        path, anchor = posixpath.normpath(posixpath.join(folder, link[1])), link[2] or ""
        page = page_of(path)
        if page is None:
            log.warning(f"{file} leads to {path}, of which the site has no page", type="repository")
            return link[0]
        return f"/{page}{'' if '#' in page else anchor}"

    return LINK.sub(lead, text)


def on_page(app: Sphinx, docname: str, source: list[str]) -> None:
    """Lead the links of a page of docs/."""
    source[0] = led(source[0], posixpath.join("docs", posixpath.dirname(docname)), docname)


def on_included(app: Sphinx, path: Path, parent: str, content: list[str]) -> None:
    """Lead the links of a file that is included from where it lies."""
    file = posixpath.normpath(posixpath.join("docs", str(path)))
    content[0] = led(content[0], posixpath.dirname(file), file)


def setup(app: Sphinx) -> dict[str, bool]:
    """Read Markdown so."""
    app.connect("source-read", on_page)
    app.connect("include-read", on_included)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
