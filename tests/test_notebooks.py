"""Notebooks run from their first cell to their last, as after "Restart Kernel and Run All Cells"."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import nbformat
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NOTEBOOKS = sorted((EXAMPLES / "notebooks").glob("*.ipynb"))
#: The cells of a notebook in IPython, which shows the last value of each; then what an expression is among their names.
RUN = """\
import json, sys, warnings
from pathlib import Path

import hpop.view.page, hpop.view.save, nbformat
from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config

name, expression = sys.argv[1:]
hpop.view.page.SCREEN = hpop.view.save.DPI = 30  # the same pictures of fewer pixels
settings = Config()
settings.HistoryManager.enabled = False
shell = InteractiveShell.instance(config=settings, colors="nocolor")
pictures, shown = [], shell.display_formatter.format

def noted(value, *arguments, **options):
    content, about = shown(value, *arguments, **options)
    pictures.extend([value] * ("image/png" in content or "<img " in content.get("text/html", "")))
    return content, about

shell.display_formatter.format = noted
warnings.simplefilter("error")
for cell in nbformat.read(name, as_version=4).cells:
    if cell.cell_type == "code":
        shell.run_cell(cell.source).raise_error()
Path("result.json").write_text(json.dumps([len(pictures), shell.ev(expression)]))
"""


def test_there_are_notebooks_to_run():
    assert [path.stem for path in NOTEBOOKS] == ["01_museum", "02_own_criterion", "03_real_map", "04_own_graph"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_valid_and_kept_without_what_running_it_leaves(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize(
    ("name", "pictures", "expression", "expected"),
    [
        # These two do what examples/01_museum.py and 03_own_criterion.py do, which have tests of their own.
        pytest.param(
            "01_museum",
            5,
            "[front.status, len(few) > 5, Path('out/camera.csv').read_text()[:5]]",
            ["complete", True, "t (s)"],
            marks=pytest.mark.proof,
        ),
        pytest.param(  # sixty degrees beside the sun, cos^4 = 1/16 of 26 s
            *("02_own_criterion", 3, "round(aside.best('length').costs['glare'], 6)", 1.625), marks=pytest.mark.proof
        ),
        pytest.param(
            *("03_real_map", 4, "['obstacle' in str(refused), bool(point.costs['turns'] <= 6)]", [True, True]),
            marks=pytest.mark.proof,
        ),
        (
            "04_own_graph",
            0,
            "[len(front) == len(paths), len(near) < len(paths), bool(max(flat.values[:, 1]) <= 60)]",
            [True] * 3,
        ),
    ],
)
def test_a_notebook_runs_and_shows_what_it_says(warm, tmp_path, name, pictures, expression, expected):
    folder = shutil.copytree(EXAMPLES / "notebooks", tmp_path / "notebooks")
    shutil.copy(EXAMPLES / "museum.geojson", tmp_path)
    environment = {"IPYTHONDIR": str(tmp_path / "ipython"), "MPLCONFIGDIR": str(tmp_path)}
    done = warm.run(f"{name}.ipynb", expression, cwd=folder, code=RUN, environment=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr  # of what shows a value: IPython goes on after it
    assert json.loads((folder / "result.json").read_text()) == [pictures, expected]
