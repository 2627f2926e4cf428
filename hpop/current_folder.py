"""The current folder, where the command line runs none of what lies about: a scenario's folder may be a stranger's.

Python looks there for modules in processes that it starts, numba for a configuration that names a folder of compiled
code, Matplotlib for one that names a backend. (IPOPT's is turned off where its options are.)
"""

from __future__ import annotations

import os
from typing import Any

CONFIGURATIONS = (".numba_config.yaml", "matplotlibrc")


def distrust() -> None:
    """Read no modules and no configuration from the current folder, in this process and those that it starts.

    Both libraries ask ``os.path.exists`` for their file by its bare name, when they are imported and numba whenever it
    compiles, before they look at any variable; neither has a switch. So the question is answered here. (To change
    the folder meanwhile would move the files that threads open.) ``--import`` finds modules there all the same: that
    is the user's own word.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if getattr(os.path.exists, "__module__", "") == __name__:
        return
    exists = os.path.exists

    def exists_elsewhere(path: Any) -> bool:
        return path not in CONFIGURATIONS and exists(path)

    os.path.exists = exists_elsewhere
