"""Parser of XML from untrusted files: bounded in the number and depth of elements, without document types or entities.

An entity may expand to a thousand others, or include a local file. None of the formats that hpop reads needs entities.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from hpop.base.text import printable
from hpop.errors import HpopError

MOST_NESTED = 50


def parsed_xml(data: bytes, error: Callable[[str], HpopError], most_elements: int, remedy: str) -> Element:
    """Parse the bytes of a file and return its outermost element; raise ``error`` if it is no XML, or refused XML.

    error          function that makes an error from what is wrong
    most_elements  largest number of elements
    remedy         what to do if there are more
    """
    builder, parser, nested, elements = TreeBuilder(), expat.ParserCreate(), 0, 0

    def refuse(*_: Any) -> None:
        raise error(
            "it must not have a document type or entities; replace each entity by its contents, remove <!DOCTYPE>"
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal nested, elements
        nested, elements = nested + 1, elements + 1
        if nested > MOST_NESTED or elements > most_elements:
            raise error(
                f"it must have at most {most_elements:,} elements, nested at most {MOST_NESTED} deep, but it has more; "
                f"{remedy}"
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal nested
        nested -= 1
        builder.end(tag)

    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.buffer_text = builder.data, True
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as fault:
        if isinstance(fault, HpopError):
            raise
        raise error(f"it must be XML, but cannot be parsed ({printable(fault)[:80]}); correct it") from None
    return builder.close()
