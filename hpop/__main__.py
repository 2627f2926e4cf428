"""``python -m hpop``: the command line, run as ``hpop`` runs it."""

from __future__ import annotations

import os
import sys

if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
    del sys.path[0]  # as of the command: nothing is imported that lies in the current folder

from hpop.entry import main

if __name__ == "__main__":
    main()
