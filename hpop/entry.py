"""Process of the command ``hpop``: the code that runs before and after :func:`hpop.cli.main`.

Ctrl-C ends the command without a traceback, even while modules are imported. A search continues if the reader of its
output ends (``hpop plan ... | head -1``) or the terminal is closed. No code from the current folder is run.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import IO, Any

INTERRUPTED = 130
BAD_FILE = 4
NUMBA_SETTINGS = ".numba_config.yaml"
LEFT = (errno.EPIPE, errno.EIO)  # errors for a pipe without a reader, and for a closed terminal


def main() -> None:
    """Run the command line."""
    try:
        _open_closed_streams()
        _distrust_current_folder()
        os.environ["MPLBACKEND"] = "agg"  # draws to files, independent of a desktop or a notebook
        sys.stdout, sys.stderr = _tolerant_stream(sys.stdout), _tolerant_stream(sys.stderr)
        _drop_invalid_epoch()
        from hpop.cli import main as command  # imports click, which takes a tenth of a second

        command(prog_name="hpop")  # the same name if it is run as python -m hpop
    except KeyboardInterrupt:
        sys.stderr.write("error: interrupted\n")
        sys.exit(INTERRUPTED)


def _distrust_current_folder() -> None:
    """Keep child processes from importing from the current folder, because anyone may have written there.

    In this process, sys.path lacks that folder: ``hpop.__main__`` removes it, and the script ``hpop`` never has it.

    Numba also reads settings from the current folder. They can name a folder of compiled code, and this cannot be
    turned off, so the command ends if such a file exists. Settings of Matplotlib are undone after it is imported
    (:mod:`hpop.view`), and settings of IPOPT are turned off together with its other options.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if os.path.exists(NUMBA_SETTINGS):
        sys.stderr.write(
            f"error: the current folder has a file {NUMBA_SETTINGS}, from which numba would read settings, such as a "
            "folder of compiled code to run; remove it, or run hpop from another folder\n"
        )
        sys.exit(BAD_FILE)


def _drop_invalid_epoch() -> None:
    """Ignore a SOURCE_DATE_EPOCH that is not a whole number, with a note; NumPy and Matplotlib would raise an error."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is not None and not (epoch.isascii() and epoch.isdigit()):
        del os.environ["SOURCE_DATE_EPOCH"]
        sys.stderr.write(
            f"note: SOURCE_DATE_EPOCH must be a whole number of seconds, got {epoch!a:.40}; it is ignored\n"
        )


def _open_closed_streams() -> None:
    """Open standard streams that are closed (``hpop plan ... >&-``) on the null device.

    Otherwise, files that are opened later would get their numbers, and would receive the output of libraries.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is the stream's
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            raw: Any = io.FileIO(number, mode, closefd=False)
            buffered = io.BufferedReader(raw) if mode == "r" else io.BufferedWriter(raw)
            setattr(sys, name, io.TextIOWrapper(buffered, encoding="utf-8", line_buffering=True))


class _TolerantStream(io.FileIO):
    """Output stream that discards what is written after its reader has ended.

    The first other error of writing raises OutputError; output after it is discarded, too.
    """

    failed = False

    def write(self, data: Any, /) -> int:
        try:
            if not self.failed:
                return super().write(data) or 0
        except OSError as error:
            if error.errno not in LEFT:
                from hpop.errors import OutputError  # Ctrl-C is handled only once main runs

                self.failed = True  # further output is discarded
                raise OutputError(f"cannot print: {error.strerror or error}; send the output elsewhere") from None
        return len(memoryview(data).cast("B"))


def _tolerant_stream(stream: Any) -> IO[str]:
    """Return a text stream to the file of ``stream`` that is a :class:`_TolerantStream` below.

    Characters missing in its encoding are escaped. A stream that is closed or has no file is returned unchanged.
    """
    try:
        raw = _TolerantStream(stream.fileno(), "w", closefd=False)
    except (AttributeError, OSError):  # the stream is closed, or is no file
        return stream  # type: ignore[no-any-return]
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering,
    )
