"""Launcher of one foreign program in a process of its own; it writes the program's seconds and peak memory as JSON.

    python launch.py RESULT_FILE TIME_LIMIT COMMAND [ARGUMENT ...]

Linux counts the memory of a process from its fork on, so a child of a large process seems large. Therefore the launcher
imports only small modules of the standard library: a program shows at least its 15 MB.
"""

import json
import os
import signal
import subprocess
import sys
import time
from typing import Any

MISSING = 127  # exit status of a command that cannot be run, as in shells
KIB = 1024  # bytes; the unit of ru_maxrss


def main(file: str, limit: float, command: list[str]) -> None:
    """Run a command, kill it and its children after ``limit`` s, and write its times, s, and memory, bytes, as JSON."""
    is_late = False
    began = time.perf_counter()
    try:
        child = subprocess.Popen(command, start_new_session=True)
    except OSError as error:
        sys.stderr.write(f"{command[0]}: {error.strerror}\n")
        sys.exit(MISSING)

    def end(*_: Any) -> None:
        nonlocal is_late
        is_late = True
        os.killpg(child.pid, signal.SIGKILL)

    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, limit)
    _, status, used = os.wait4(child.pid, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    result = {
        "is_late": is_late,
        "exit_status": os.waitstatus_to_exitcode(status),
        "seconds": time.perf_counter() - began,
        "processor_seconds": used.ru_utime + used.ru_stime,
        "memory": used.ru_maxrss * KIB,
    }
    with open(file, "w", encoding="ascii") as out:
        json.dump(result, out)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), sys.argv[3:])
