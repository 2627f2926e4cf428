"""Docstrings as the house writes them, for autodoc: readable as plain text, shown as lists of definitions.

Fields stand in columns: the name, then what there is of a shape and a unit, then the meaning::

    positions  (N, 3)  m   camera origin, world frame,
                           where it is mounted
    times      (N,)    s   strictly increasing

Parameters, where they need more than their names, stand under a line, as numpydoc has them or in one sentence::

Parameters
----------
    scale : float
        Metres per unit of the file.
    say : called now and then with what is being done

Formulas, with their columns, are shown as they stand. A section ends where a line is blank. All else is
reStructuredText, in which a bar is a bar: ``|x|`` is an absolute value, no substitution.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from sphinx.application import Sphinx

NAME = r"(?:\*{0,2}[A-Za-z_][\w.]*(?:\(\))?|\"[^\"]*\"|\d+|``[^`]+``)"
FIELD = re.compile(rf"^{NAME}(?:, {NAME})*(?: \([^)]*\))? {{2,}}\S")
COLUMNS = re.compile(r" {2,}")
BULLET = re.compile(r"^(?:[-*] |\d+\. |\.\. |:\w+)")
FULL = 64  # letters: a sentence goes on in the next line only where this one is full
CODE = re.compile(r"(``.*?``|`[^`]*`)")


def code(names: str) -> str:
    """Names, divided by commas, as code."""
    return ", ".join(part if "`" in part else f"``{part}``" for part in names.split(", "))


def entries(block: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Lines that begin at the margin, each with the indented ones that follow."""
    first, others = block[0], []
    for line in block[1:]:
        if line.startswith(" "):
            others.append(line.strip())
        else:
            yield first, others
            first, others = line, []
    yield first, others


def is_fields(block: list[str]) -> bool:
    """Return True for a paragraph of names and their meanings, in columns.

    >>> is_fields(["a prose of", "two lines"]), is_fields(["x  m  ahead"]), is_fields([">>> f()  # why"])
    (False, True, False)
    """
    return bool(FIELD.match(block[0])) and all(line.startswith(" ") or FIELD.match(line) for line in block)


def fields(block: list[str]) -> Iterator[str]:
    """Yield a block of columns as definitions.

    >>> print(*fields(["times  (N,)  s  increasing,", "                without gaps", "kind   one of three"]), sep="|")
    ``times`` : (N,), s|    increasing, without gaps|``kind``|    one of three
    """
    for first, others in entries(block):
        names, *between, meaning = COLUMNS.split(first)
        yield f"{code(names)} : {', '.join(between)}" if between else code(names)
        yield "    " + plain(" ".join([meaning, *others]))


def section(block: list[str]) -> Iterator[str]:
    """Yield a section of numpydoc: a heading and a line, then names with a type and a meaning, or with a sentence.

    >>> print(*section(["Parameters", "----------", "scale : float", "    Of it, m.", "say : is called"]), sep="|")
    .. rubric:: Parameters||``scale`` : float|    Of it, m.|``say``|    is called|
    """
    yield from (f".. rubric:: {block[0]}", "")
    for first, others in entries(block[2:]):
        names, colon, text = first.partition(" : ")
        if not colon and not others:
            yield plain(first)
        elif not others or len(first) > FULL:
            yield from (code(names), "    " + plain(" ".join([text, *others])))
        else:
            yield f"{code(names)} : {plain(text)}" if colon else code(names)
            yield "    " + plain(" ".join(others))
    yield ""


def is_formula(block: list[str]) -> bool:
    """Return True for lines that are laid out on purpose: indented beyond the first, with columns of their own.

    >>> is_formula(["Felt:  w = T s", "       v = f - v"]), is_formula(["- a point", "  that goes on"])
    (True, False)
    """
    return (
        len(block) > 1
        and not BULLET.match(block[0])
        and any(line.startswith(" ") for line in block[1:])
        and any(COLUMNS.search(line.strip()) for line in block)
    )


def plain(text: str) -> str:
    """Text in which a bar is no markup.

    >>> print(plain("|x| of ``a | b``").replace(chr(92), "/"))  # backslashes as slashes
    /|x/| of ``a | b``
    """
    parts = CODE.split(text)
    return "".join(part if k % 2 else part.replace("|", r"\|") for k, part in enumerate(parts))


def paragraphs(lines: list[str]) -> Iterator[list[str]]:
    """Lines of a docstring in blocks, each of which is blank or not."""
    block: list[str] = []
    for line in lines:
        if block and bool(line.strip()) != bool(block[0].strip()):
            yield block
            block = []
        block.append(line)
    if block:
        yield block


def rewritten(lines: list[str]) -> list[str]:
    """Return a docstring as reStructuredText."""
    written: list[str] = []
    verbatim = False  # what is indented after a "::"
    for block in paragraphs(lines):
        if not block[0].strip():
            written += block
            continue
        verbatim = verbatim and block[0].startswith(" ")
        if verbatim or block[0].startswith(">>>"):
            written += block
        elif len(block) > 1 and re.fullmatch("-+", block[1]):
            if block[0] == "Examples":
                written += [".. rubric:: Examples", "", *block[2:]]
            else:
                written += section(block)
        elif is_fields(block):
            written += fields(block)
        elif is_formula(block):
            written += ["::", "", *(f"    {line}" for line in block)]
        else:
            written += [plain(line) for line in block]
        verbatim = verbatim or block[-1].rstrip().endswith("::")
    return written


def on_docstring(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Rewrite a docstring in place."""
    lines[:] = rewritten(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite what autodoc reads."""
    app.connect("autodoc-process-docstring", on_docstring)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
