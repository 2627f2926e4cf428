"""Files of maps: bytes and hashes, plain YAML, relative paths, and foreign formats, which are read in a child process.

If the child process crashes, hangs or takes too much memory, this process is not harmed.
"""

from __future__ import annotations

import codecs
import hashlib
import json
import os
import re
import signal
import sys
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from hpop.apart.child import ChildAnswer, ChildRefused, unpack
from hpop.base.files import read_regular
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import READING

MAX_BYTES = 1_000_000_000
"""Largest file that is read, bytes."""
MAX_DEPTH = 20
"""Deepest nesting of a yaml file."""
MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte-order marks of UTF-16."""
PROBE = 1_000
"""Bytes before and after an invalid byte that are examined to guess the encoding."""


_BEGINS, _ENDS = re.compile(r"(?<![^\s'\"(\[])/"), re.compile(r"(?=[\s'\":;,)\]])|\.?$")
CODE = "from hpop.apart.child import serve; serve()"
MEMORY = 2 * 10**9
"""Largest address space of the child process that reads a file, bytes."""
SECONDS = 60
"""Longest processor time of the child process, s."""
POLL = 0.05
"""Time between two checks of the limits, s."""
WAITS = 10 * SECONDS
"""Time after which a child process without progress is given up, s."""
STAYS = 8
"""Bytes of memory per byte of the output of the child process: for its geometries."""


def read_bytes(path: str | Path, what: str, *, limit: int = MAX_BYTES) -> bytes:
    """Return a file's bytes; `MapError` if it is missing, empty, too large, unreadable or no regular file."""
    if not isinstance(path, str | os.PathLike):  # a number would name an open file
        raise MapError(f"{what} is named by its path; got {shown(path)}.")
    try:
        data = read_regular(path, limit)
    except OSError as error:
        raise MapError(f"{what} {named(path)} cannot be opened: {error.strerror or error}. Check the path.") from None
    if not data:
        raise MapError(f"{what} {named(path)} is empty (0 bytes).")
    return data


def named(path: str | Path) -> str:
    """Return a path for a message, shortened if it is longer than any system allows."""
    return shown(str(path), 400)


def read_text(data: bytes, path: str | Path, what: str) -> str:
    """Decode UTF-8 text; a `MapError` names the probable encoding of other bytes. ``what`` names the file."""
    if not data.startswith(MARKS) and _is_wide(data[:PROBE]):
        raise MapError(
            f"{what} {named(path)} must be UTF-8 text. It seems to be UTF-16 or UTF-32 without a byte-order mark: save "
            "it as UTF-8."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapError(
            f"{what} {named(path)} must be UTF-8 text; byte {error.start} is not. {_encoding_of(data, error.start)}"
        ) from None


def _is_wide(data: bytes) -> bool:
    """Return whether bytes seem to be UTF-16 or UTF-32 text.

    Of two bytes per letter, every second is 0; of four bytes per letter, all but the first or the last are 0.
    """
    quarters = [data[i::4] for i in range(4)]
    zero = [quarter.count(0) > 0.9 * len(quarter) for quarter in quarters]
    letters = [quarter.count(0) < 0.1 * len(quarter) for quarter in quarters]
    patterns = ("x0x0", "0x0x", "x000", "000x")
    return len(data) >= 8 and any(
        all((letters if mark == "x" else zero)[i] for i, mark in enumerate(pattern)) for pattern in patterns
    )


def _encoding_of(data: bytes, first: int) -> str:
    """Return advice on the probable encoding of bytes; at index ``first`` they stop to be UTF-8."""
    if data.startswith(MARKS):
        return "It is UTF-16, as PowerShell's > and Notepad's Unicode write it: save it as UTF-8."
    around = data[max(0, first - PROBE) : first + PROBE]
    if all(byte >= 32 or byte in b"\t\n\r\f" for byte in around):
        return "It seems to be Latin-1 or Windows-1252, of umlauts or accents perhaps: save it as UTF-8."
    return "Is it another kind of file?"


def read_yaml(text: str, path: str | Path) -> Any:
    """Load plain YAML as `read_yaml_documents` does, but only one document; `MapError` for several."""
    documents = read_yaml_documents(text, path)
    if len(documents) > 1:
        raise MapError(f"{path} is {len(documents)} yaml documents, one after the other (---); expected one.")
    return documents[0] if documents else None


def read_yaml_documents(text: str, path: str | Path) -> list[Any]:
    """Load all non-empty documents of plain YAML.

    Raises `MapError` for Python tags, aliases, wrong syntax, and nesting deeper than `MAX_DEPTH`.

    Nesting is checked on the events first, because deep nesting crashes PyYAML's C loader. Aliases are refused because
    aliases of aliases double a value's size with every line.
    """
    import yaml  # slow to import

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    event: Any
    try:
        for event in yaml.parse(text, Loader=loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise MapError(f"{path} nests values more than {MAX_DEPTH} deep: it is no map file.")
            if getattr(event, "anchor", None):
                line = event.start_mark.line + 1
                raise MapError(f"{path}, line {line}: anchors and aliases are not read; write the values out.")
        return [document for document in yaml.load_all(text, Loader=loader) if document is not None]
    except (yaml.YAMLError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        reason = " ".join(str(error).split())
        raise MapError(f"{path} is not a yaml file that may be loaded: {reason}") from None


def sha256(data: bytes) -> str:
    """Return the hexadecimal SHA-256 of a file's content."""
    return hashlib.sha256(data).hexdigest()


def file_source(reader: str, path: str | Path, options: dict[str, Any], *contents: bytes) -> dict[str, Any]:
    """Describe a world by its reader, the absolute path of its file, the options, and the hashes of all files read."""
    return {
        "kind": reader,
        "path": os.path.abspath(path),
        "options": options,
        "sha256": [sha256(content) for content in contents],
    }


def place_seen_from(folder: str, path: str) -> str:
    """Return the path of a file relative to a folder; if this leads through the home folder (~), relative to that.

    The result is written into files that are passed on, so it names neither user nor machine. For a file on another
    drive it is the file name alone.
    """
    home = os.path.abspath(os.path.expanduser("~"))
    try:
        if _lies_in(home, path) and not _lies_in(home, folder):
            return Path("~", os.path.relpath(path, home)).as_posix()
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return os.path.basename(path)


def by_names(note: str) -> str:
    """Return a note with file names in place of absolute paths, since fronts and pages with notes are passed on.

    A path begins after a space, quote or bracket, ends before one of these, a colon or a comma, and must name an
    existing file.
    """
    kept, done = [], 0
    for begin in _BEGINS.finditer(note):
        if begin.start() < done:
            continue
        ends = [begin.start() + end.start() for end in _ENDS.finditer(note[begin.start() :])][::-1]
        end = next((end for end in ends if os.path.isfile(note[begin.start() : end])), None)
        if end is not None:
            kept += [note[done : begin.start()], os.path.basename(note[begin.start() : end])]
            done = end
    return "".join([*kept, note[done:]])


def places_found_from(folder: str, seen: str) -> list[str]:
    """Return two absolute paths for a result of :func:`place_seen_from`: its own, and its name in the folder."""
    there = os.path.abspath(os.path.join(folder, os.path.expanduser(seen) if seen.startswith("~/") else seen))
    return [there, os.path.join(os.path.abspath(folder), os.path.basename(there))]


def _lies_in(folder: str, path: str) -> bool:
    """Return whether a path is within a folder; False for the root folder."""
    return os.path.dirname(folder) != folder and os.path.commonpath([folder, os.path.abspath(path)]) == folder


def extract(module: str, path: str | Path, data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Read a file with a module of `hpop.apart` in a child process, and return its contents; `MapError` if invalid.

    Meanwhile the limits of the running plan are checked; if one passes, the child process is killed.
    """
    settings = {"module": module, "options": options, "memory": MEMORY, "seconds": SECONDS}
    output = _child_output(settings, data, path)
    try:
        answer = unpack(output)
    except ChildRefused as refused:
        raise MapError(f"{named(path)}: {refused}.") from None
    except (ValueError, KeyError, TypeError):
        raise MapError(f"{named(path)} cannot be read: the process that reads it gave no answer.") from None
    limits.hold(READING, STAYS * len(output))
    return answer


def _child_output(settings: dict[str, Any], data: bytes, path: str | Path) -> bytes:
    """Run the child process within bounds of time and memory, and return its output."""
    with TemporaryDirectory(prefix="hpop-") as folder:
        request = Path(folder) / "request"  # a pipe would have to be fed while the limits are checked
        request.write_bytes(json.dumps(settings).encode() + b"\n" + data)
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "TMPDIR": folder}
        with request.open("rb") as stdin, interrupts_held():
            # A session of its own, so that Ctrl-C on the terminal does not reach it.
            process = Popen(
                [sys.executable, "-P", "-c", CODE],
                stdin=stdin,
                stdout=PIPE,
                stderr=DEVNULL,
                env=environment,
                start_new_session=True,
            )
        try:
            end = monotonic() + WAITS
            while True:
                try:
                    output, _ = process.communicate(timeout=POLL)
                    break
                except TimeoutExpired:
                    limits.check(READING)
                    if monotonic() > end:
                        raise MapError(f"{named(path)} was not read within {WAITS} s; make it smaller.") from None
        finally:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()
    if process.returncode == -getattr(signal, "SIGXCPU", 0):
        raise MapError(f"{named(path)} takes more than {SECONDS} processor seconds to read; make it smaller.")
    if process.returncode:
        raise MapError(
            f"{named(path)} cannot be read: the process that reads it broke down ({process.returncode}). Is the file "
            f"broken, or does it take more than {MEMORY / 1e9:.2g} GB to read?"
        )
    return output
