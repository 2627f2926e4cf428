"""Access to map files: bytes and hashes, plain YAML, relative paths, and formats that a child process reads.

Formats that need large external libraries are read in a child process. If it crashes, hangs or takes too much memory,
this process is not harmed.
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
from hpop.errors import MapError, meant_file
from hpop.runtime import limits
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import READING

MAX_BYTES = 1_000_000_000
"""Size of the largest file that is read, bytes."""
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
"""Time after which a child process is ended, s."""
STAYS = 8
"""Bytes of memory that the geometries take per byte of the child process's output."""


def read_bytes(path: str | Path, what: str, *, limit: int = MAX_BYTES) -> bytes:
    """Return a file's bytes; `MapError` if it is missing, empty, too large, unreadable or no regular file."""
    if not isinstance(path, str | os.PathLike):  # a number would name an open file
        raise MapError(f"{what} must be given by its path, a str or Path; got {shown(path)}.")
    try:
        data = read_regular(path, limit)
    except OSError as error:
        near = meant_file(Path(path)) if isinstance(error, FileNotFoundError) else ""
        remedy = "Check its permissions" if isinstance(error, PermissionError) else "Check the path"
        raise MapError(f"{what} {named(path)} cannot be opened: {error.strerror or error}. {remedy}.{near}") from None
    if not data:
        raise MapError(f"{what} {named(path)} is empty (0 bytes). Check the file.")
    return data


def named(path: str | Path) -> str:
    """Return a path as text for a message, shortened if it is very long."""
    return shown(str(path), 400)


def read_text(data: bytes, path: str | Path, what: str) -> str:
    """Decode the bytes of a file as UTF-8 text; for other encodings a `MapError` names the probable one.

    ``what`` and ``path`` name the file in the message.
    """
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
    """Return whether bytes seem to be UTF-16 or UTF-32 text, judging by the positions of zero bytes.

    In Latin text, every second byte of UTF-16 is 0, and all bytes of UTF-32 but the first or the last of four are 0.
    """
    quarters = [data[i::4] for i in range(4)]
    zero = [quarter.count(0) > 0.9 * len(quarter) for quarter in quarters]
    letters = [quarter.count(0) < 0.1 * len(quarter) for quarter in quarters]
    patterns = ("x0x0", "0x0x", "x000", "000x")
    return len(data) >= 8 and any(
        all((letters if mark == "x" else zero)[i] for i, mark in enumerate(pattern)) for pattern in patterns
    )


def _encoding_of(data: bytes, first: int) -> str:
    """Return advice for a message: the probable encoding of bytes that are not UTF-8 from index ``first`` on."""
    if data.startswith(MARKS):
        return "It is UTF-16, as PowerShell's > and Notepad's Unicode write it: save it as UTF-8."
    around = data[max(0, first - PROBE) : first + PROBE]
    if all(byte >= 32 or byte in b"\t\n\r\f" for byte in around):
        return "It seems to be Latin-1 or Windows-1252, with umlauts or accents perhaps: save it as UTF-8."
    return "It may be another kind of file; check the path."


def read_yaml(text: str, path: str | Path) -> Any:
    """Load a plain YAML file and return its one document, or None if it is empty.

    Raises `MapError` for several documents, and for all that `read_yaml_documents` refuses.
    """
    documents = read_yaml_documents(text, path)
    if len(documents) > 1:
        raise MapError(
            f"{path} has {len(documents)} yaml documents, separated by ---; expected one. Leave the others out."
        )
    return documents[0] if documents else None


def read_yaml_documents(text: str, path: str | Path) -> list[Any]:
    """Load all non-empty documents of a plain YAML file.

    Raises `MapError` for Python tags, aliases, wrong syntax, and nesting deeper than `MAX_DEPTH`. Nesting is checked on
    the parser's events before loading, because deep nesting crashes PyYAML's C loader. Aliases are refused because
    aliases of aliases can double a value's size with every line.
    """
    import yaml  # slow to import

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    event: Any
    try:
        for event in yaml.parse(text, Loader=loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise MapError(f"{path} nests values more than {MAX_DEPTH} deep, so it cannot be a map file.")
            if getattr(event, "anchor", None):
                line = event.start_mark.line + 1
                raise MapError(f"{path}, line {line}: anchors and aliases are not read; write the values out.")
        return [document for document in yaml.load_all(text, Loader=loader) if document is not None]
    except (yaml.YAMLError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        reason = " ".join(str(error).split())
        raise MapError(f"{path} is not a plain yaml file: {reason}") from None


def sha256(data: bytes) -> str:
    """Return the SHA-256 hash of a file's content, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def file_source(reader: str, path: str | Path, options: dict[str, Any], *contents: bytes) -> dict[str, Any]:
    """Return a world's description by its files: reader, absolute path, options, and SHA-256 of all files' contents."""
    return {
        "kind": reader,
        "path": os.path.abspath(path),
        "options": options,
        "sha256": [sha256(content) for content in contents],
    }


def place_seen_from(folder: str, path: str) -> str:
    """Return the path of a file relative to a folder.

    If the file is in the home folder but ``folder`` is not, the path begins with ~. If they are on different drives, it
    is the file name alone. So the result, which is saved in files that people share, does not show the home folder.
    """
    home = os.path.abspath(os.path.expanduser("~"))
    try:
        if _lies_in(home, path) and not _lies_in(home, folder):
            return Path("~", os.path.relpath(path, home)).as_posix()
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return os.path.basename(path)


def by_names(note: str) -> str:
    """Return a note with each absolute path replaced by its file name, because people share fronts that hold notes.

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
    """Return two absolute paths where a file may be, given a result ``seen`` of :func:`place_seen_from`.

    The first is the path relative to the folder or to ~, the second the file's name directly in the folder.
    """
    there = os.path.abspath(os.path.join(folder, os.path.expanduser(seen) if seen.startswith("~/") else seen))
    return [there, os.path.join(os.path.abspath(folder), os.path.basename(there))]


def _lies_in(folder: str, path: str) -> bool:
    """Return whether a path is within a folder; False for the root folder."""
    return os.path.dirname(folder) != folder and os.path.commonpath([folder, os.path.abspath(path)]) == folder


def extract(module: str, path: str | Path, data: bytes, options: dict[str, Any]) -> ChildAnswer:
    """Read a file with a module of `hpop.apart` in a child process, and return its contents; `MapError` if invalid.

    ``data`` are the bytes of the file, ``options`` those of the module's function ``extract``.
    Meanwhile the time and memory limits of the running plan are checked. If one is exceeded, the child process is
    killed.
    """
    settings = {"module": module, "options": options, "memory": MEMORY, "seconds": SECONDS}
    output = _child_output(settings, data, path)
    try:
        answer = unpack(output)
    except ChildRefused as refused:
        raise MapError(f"{named(path)}: {refused}.") from None
    except (ValueError, KeyError, TypeError):
        raise MapError(
            f"{named(path)} cannot be read: the answer of the child process that reads it is garbled. Make sure that "
            "nothing prints when Python starts (such as a sitecustomize module); otherwise report this with the file."
        ) from None
    limits.hold(READING, STAYS * len(output))
    return answer


def _child_output(settings: dict[str, Any], data: bytes, path: str | Path) -> bytes:
    """Run the child process within limits of time and memory, and return its output."""
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
        raise MapError(f"{named(path)} takes more than {SECONDS} s of processor time to read; make it smaller.")
    if process.returncode:
        raise MapError(
            f"{named(path)} cannot be read: the child process that reads it crashed (exit code {process.returncode}). "
            f"Check that the file is intact, and that it takes less than {MEMORY / 1e9:.2g} GB of memory to read."
        )
    return output
