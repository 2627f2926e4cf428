"""Run a notebook from its first cell to its last, and write out/outputs.json: what each cell shows.

    python docs/run_notebook.py NOTEBOOK

One list a cell of code, in order: ``{"text": ...}``, ``{"html": ...}`` or ``{"picture": path}`` of what it printed and
showed. A figure of pyplot that a cell leaves open is shown and closed, as Jupyter does. It is run in the notebook's
folder copied to here, so that what it writes stays here.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import nbformat
from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from traitlets.config import Config


def shown(data: dict[str, Any], picture: Path) -> dict[str, str]:
    """Return the richest form of a value: a picture, which is written to a file, HTML, or text."""
    if "image/png" in data:
        content = data["image/png"]
        picture.write_bytes(base64.b64decode(content) if isinstance(content, str) else content)
        return {"picture": str(picture)}
    return {"html": data["text/html"]} if "text/html" in data else {"text": data["text/plain"]}


def main(notebook: Path) -> None:
    """Run it, and write what it shows."""
    out = Path("out").absolute()
    out.mkdir()
    folder = Path("run/notebooks").absolute()
    shutil.copytree(notebook.resolve().parent, folder)
    for path in notebook.resolve().parents[1].glob("*.geojson"):
        shutil.copy(path, folder.parent)
    os.chdir(folder)
    settings = Config()
    settings.HistoryManager.enabled = False
    shell = InteractiveShell.instance(config=settings, colors="nocolor")
    outputs: list[list[dict[str, str]]] = []
    for cell in nbformat.read(notebook.name, as_version=4).cells:
        if cell.cell_type != "code":
            continue
        values: list[dict[str, Any]] = []
        shell.display_trap.hook = CapturingDisplayHook(shell, values)
        with capture_output(display=False) as captured:
            result = shell.run_cell(cell.source)
        result.raise_error()
        if cell.source.rstrip().endswith(";"):
            values.clear()
        name = f"{notebook.stem}_{len(outputs)}"
        found = [{"text": captured.stdout}] if captured.stdout.strip() else []
        found += [shown(value["data"], out / f"{name}_{k}.png") for k, value in enumerate(values)]
        if "matplotlib.pyplot" in sys.modules:
            pyplot = sys.modules["matplotlib.pyplot"]
            for number in pyplot.get_fignums():
                pyplot.figure(number).savefig(out / f"{name}_figure{number}.png", dpi=100)
                found.append({"picture": str(out / f"{name}_figure{number}.png")})
            pyplot.close("all")
        outputs.append(
            [entry if "picture" not in entry else {"picture": Path(entry["picture"]).name} for entry in found]
        )
    text = json.dumps(outputs, indent=1).replace(str(folder.parent), "..")  # where it ran is nobody's concern
    (out / "outputs.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
