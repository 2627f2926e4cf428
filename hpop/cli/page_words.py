"""Texts of the page of ``hpop prefer --web``, in the participant's language.

Each language is a JSON file, ``words/LANGUAGE.json``. Names of hpop's criteria are among the texts, except in English,
where costs have the names of their criteria. A criterion of your own keeps its name in every language.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources

LANGUAGES = ("en", "de", "fi")
COMMA = {"de", "fi"}
"""Languages with a decimal comma."""


@dataclass(frozen=True)
class PageWords:
    """Texts in one language; :func:`words_of` reads them.

    language  such as "de"
    texts     text by name
    """

    language: str
    texts: dict[str, str]

    def say(self, name: str, **given: object) -> str:
        """Return a text, with values in place of the ``{names}`` in it."""
        return self.texts[name].format(**given)

    def cost(self, name: str) -> str:
        """Return the name of a cost; that of an unknown criterion as it is."""
        return self.texts.get(f"cost_{name}", name)

    def number(self, text: str) -> str:
        """Return a number, given as text with a decimal point, as it is written in the language."""
        return text.replace(".", ",") if self.language in COMMA else text


@cache
def words_of(language: str) -> PageWords:
    """Return the texts in one of :data:`LANGUAGES`."""
    file = resources.files("hpop.cli").joinpath("words", f"{language}.json")
    return PageWords(language, json.loads(file.read_text(encoding="utf-8")))
