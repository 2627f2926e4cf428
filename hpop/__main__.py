"""Run the command line: ``python -m hpop`` does the same as ``hpop``."""

from __future__ import annotations

import os
import sys

if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
    del sys.path[0]  # so that no module is imported from the current folder, as for the command hpop

from hpop.entry import main

if __name__ == "__main__":
    main()
