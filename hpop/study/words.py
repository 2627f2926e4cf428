"""Texts of the participant's pages in several languages, as JSON files, so that a new language needs no code."""

from __future__ import annotations

import os
import re
from importlib import resources
from pathlib import Path
from string import Formatter

from hpop.base.files import read_regular
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import parse

FOLDER = "words"
"""Folder in a study for texts in languages that hpop does not have."""
MOST_BYTES = 200_000
LANGUAGE = re.compile(r"[a-z]{2,3}(-[A-Z]{2})?")
Words = dict[str, str]


def words(language: str, study: Path | None = None) -> Words:
    """Return the texts of the participants' pages in a language, by name.

    They are read from the study's ``words/LANGUAGE.json``, or from hpop's own file. A file must have exactly the texts
    of hpop's ``en.json``, with equal ``{names}`` in them. Raises StudyError for a language without texts, and for an
    incomplete file, with all faults at once.

    >>> words("en")["stop"]
    'Stop'
    """
    shipped = resources.files("hpop.study").joinpath("words")
    english = _english()
    if not LANGUAGE.fullmatch(language):
        raise StudyError(f"language must be a code such as 'en', 'de' or 'pt-BR', got {shown(language)}")
    name = f"{language}.json"
    own = None if study is None else study / FOLDER / name
    if own is not None and own.is_file():
        return checked_file(own)
    if not shipped.joinpath(name).is_file():
        raise StudyError(
            f"hpop has no texts in {shown(language)}: translate its hpop/study/words/en.json, and give "
            f"the file to `hpop study init --words`, which keeps it as {FOLDER}/{name}"
        )
    return _checked_texts(_read(shipped.joinpath(name).read_bytes(), name), english, name)


def checked_file(path: str | os.PathLike[str]) -> Words:
    """Read a file of texts; StudyError if it cannot be read or is incomplete."""
    try:
        return _checked_texts(_read(read_regular(path, MOST_BYTES), str(path)), _english(), str(path))
    except OSError as error:
        raise StudyError(
            f"cannot read {path}: {error.strerror or error}; give a translation of hpop/study/words/en.json"
        ) from None


def _english() -> Words:
    """Return the English texts, which every language must have."""
    return _read(resources.files("hpop.study").joinpath("words", "en.json").read_bytes(), "en.json")


def _read(data: bytes, file: str) -> Words:
    """Parse texts from JSON; StudyError unless they are an object of texts."""
    try:
        read = parse(data)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{file}: expected texts as JSON: {error}") from None
    if not isinstance(read, dict) or not all(isinstance(text, str) for text in read.values()):
        raise StudyError(f'{file}: expected an object of texts, such as {{"stop": "Stop"}}')
    return read


def _checked_texts(texts: Words, english: Words, file: str) -> Words:
    """Return texts if they are complete; StudyError, with all faults, if they differ in names or placeholders."""
    lacking, others = sorted(english.keys() - texts.keys()), sorted(texts.keys() - english.keys())
    said = [f"lacks the texts {', '.join(lacking)}"] if lacking else []
    said += [f"has {shown(', '.join(others))}, which no page uses"] if others else []
    said += [
        f"{name} must have the placeholders of the English text, {english[name]!r}"
        for name, text in texts.items()
        if name in english and _placeholders(text) != _placeholders(english[name])
    ]
    if said:
        raise StudyError(f"{file} {'; '.join(said)}; write the texts of hpop's en.json, all of them")
    return texts


def _placeholders(text: str) -> set[str] | None:
    """Return the names between braces; None if braces do not match."""
    try:
        return {field for _, field, _, _ in Formatter().parse(text) if field is not None}
    except ValueError:
        return None
