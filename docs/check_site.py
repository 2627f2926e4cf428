"""Check that every link of a built site leads somewhere, and that it needs nothing from elsewhere.

    python docs/check_site.py FOLDER

Every link within the site, of pages, pictures, scripts and styles, must lead to a file that is there and, after a `#`,
to a place in it. Nothing that a page loads may come from a network; links that a reader may follow are not fetched.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}


class Page(HTMLParser):
    """Links of a page, the files it loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag's identity and links."""
        given = dict(attrs)
        self.places |= {value for key in ("id", "name") if (value := given.get(key))}
        if tag == "a" and (target := given.get("href")):
            self.links.append(target)
        if tag in LOADED and (target := given.get(LOADED[tag])):
            self.loaded.append(target)


@cache
def read(file: Path) -> Page:
    """Read a page once."""
    return Page(file.read_text(encoding="utf-8"))


def faults(folder: Path) -> Iterator[str]:
    """Yield the faults of each page."""
    for file in sorted(folder.rglob("*.html")):
        page, name = read(file), file.relative_to(folder)
        if "_static" in name.parts:
            continue
        yield from (f"{name} loads {target}" for target in page.loaded if urlsplit(target).netloc)
        for target in dict.fromkeys(page.links + page.loaded):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            there = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not there.is_file():
                yield f"{name} leads to {target}, which is not there"
            elif parts.fragment and there.suffix == ".html" and unquote(parts.fragment) not in read(there).places:
                yield f"{name} leads to {target}, and there is no such place on that page"


def main(folder: Path) -> None:
    """Print what is wrong, and end with 1 if anything is."""
    pages = sum(1 for _ in folder.rglob("*.html"))
    found = list(faults(folder))
    print("\n".join(found) if found else f"{pages} pages in {folder}: every link within leads somewhere")
    sys.exit(1 if found or not pages else 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
