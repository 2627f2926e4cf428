"""The release: a source distribution that is whole, a wheel with the examples, extras for what code uses."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path

import numpy
import pytest
import yaml

import hpop
from hpop.examples import SCENARIOS

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
IGNORED = [line.rstrip("/") for line in (ROOT / ".gitignore").read_text().split()]
EXTRAS = {name: asked for name, asked in PROJECT["optional-dependencies"].items() if name != "dev"}


def build(what: str, source: Path, out: Path) -> Path:
    """Build a distribution as pip does, of the sources in a folder."""
    code = f"from setuptools import build_meta; print(build_meta.build_{what}({str(out)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the files that git keeps."""
    target = tmp_path_factory.mktemp("clone") / "hpop"
    return shutil.copytree(ROOT, target, symlinks=True, ignore=shutil.ignore_patterns(".git", "*.nb[ic]", *IGNORED))


@pytest.fixture(scope="module")
def unpacked(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the source distribution and unpack it as pip does."""
    folder = tmp_path_factory.mktemp("sdist")
    with tarfile.open(build("sdist", clone, folder)) as archive:
        archive.extractall(folder, filter="data")
    return folder / f"hpop-{hpop.__version__}"


@pytest.fixture(scope="module")
def wheel(unpacked: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """Build the wheel from the source distribution."""
    return zipfile.ZipFile(build("wheel", unpacked, tmp_path_factory.mktemp("wheel")))


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.proof
def test_the_source_distribution_is_whole(clone: Path, unpacked: Path) -> None:
    made = {"PKG-INFO", "setup.cfg", *(name for name in files(unpacked) if name.startswith("hpop.egg-info/"))}
    kept = {name for name in files(clone) if not name.startswith("hpop.egg-info/")}
    assert files(unpacked) - made == kept
    for name in kept:
        assert (unpacked / name).read_bytes() == (clone / name).read_bytes(), name


@pytest.mark.proof
def test_the_wheel_has_the_package_with_its_examples_and_nothing_else(wheel: zipfile.ZipFile, clone: Path) -> None:
    names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert names == {f"hpop/{name}" for name in files(clone / "hpop")}
    for name in {file for files in SCENARIOS.values() for file in files}:
        assert wheel.read(f"hpop/examples/{name}") == (ROOT / "examples" / name).read_bytes()


@pytest.mark.proof
def test_its_metadata_say_what_it_is(wheel: zipfile.ZipFile) -> None:
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = message_from_bytes(wheel.read(name))
    assert (metadata["Name"], metadata["Version"]) == ("hpop", hpop.__version__)
    assert set(metadata.get_all("Provides-Extra", [])) == {*EXTRAS, "dev"}
    assert metadata.get_all("Project-URL") == ["Paper, https://arxiv.org/abs/2002.10696"]


@pytest.mark.proof
def test_the_readmes_first_block_runs_from_any_folder_with_the_wheel(
    wheel: zipfile.ZipFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (block, *_) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    wheel.extractall(tmp_path / "installed")
    (tmp_path / "here").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "installed"))
    code = f"{block}\nprint(hpop.__file__, len(front))"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=tmp_path / "here", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path / "installed"))
    assert (tmp_path / "here/camera.csv").exists()


@pytest.mark.proof
def test_type_checkers_see_hpop_where_it_is_installed_for_editing(tmp_path: Path) -> None:
    """As pip does it: a path in a .pth file, which type checkers read; py.typed is in the folder."""
    code = "from setuptools import build_meta; print(build_meta.build_editable({!r}))"
    tree = shutil.copytree(ROOT, tmp_path / "tree", symlinks=True, ignore=shutil.ignore_patterns(".git", *IGNORED))
    done = subprocess.run(
        [sys.executable, "-c", code.format(str(tmp_path))], cwd=tree, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(tmp_path / done.stdout.split()[-1]) as archive:
        (path,) = (name for name in archive.namelist() if name.endswith(".pth"))
        assert archive.read(path).decode().split() == [str(tree)]
    packages = tmp_path / f"venv/lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    (packages / "hpop.pth").write_text(str(tree))
    (packages / "numpy.pth").write_text(str(Path(numpy.__file__).parents[1]))  # and all else that hpop needs
    (tmp_path / "own").mkdir()
    (tmp_path / "own/own.py").write_text("import hpop\nreveal_type(hpop.examples.museum().solve(step=1.0).costs)\n")
    checked = subprocess.run(
        [
            sys.executable,
            "-P",
            "-m",
            "mypy",
            "--no-incremental",
            "--python-executable",
            tmp_path / "venv/bin/python",
            "own.py",
        ],
        cwd=tmp_path / "own",
        capture_output=True,
        text=True,
        check=False,
    )
    assert "numpy.ndarray" in checked.stdout, checked.stdout


# Extras


IMPORT = re.compile(r"^[ \t]*(?:from (\w+)[\w.]* import |import (\w+)[\w.]*(?: as \w+)?(?:  #.*)?$)", re.MULTILINE)
CALL = re.compile(r"\b(?:import_module|library|__import__)\(\s*\"(\w+)")
CALLED = {"PIL": "pillow", "collada": "pycollada", "fcl": "python-fcl", "yaml": "pyyaml"}  # names at PyPI


def imported() -> set[str]:
    """Top-level modules that hpop names in an import, or in a call that imports."""
    texts = [path.read_text() for path in (ROOT / "hpop").rglob("*.py")]
    found = {name for text in texts for names in IMPORT.findall(text) for name in names if name}
    return found | {name for text in texts for name in CALL.findall(text)}


def distributions(asked: list[str]) -> set[str]:
    return {re.split(r"[<>=\[ ]", text)[0].lower() for text in asked}


def test_what_hpop_imports_it_asks_for_and_what_it_asks_for_it_imports() -> None:
    modules = imported() - set(sys.stdlib_module_names) - {"hpop", "pydantic_core"}  # pydantic names its version
    asked = distributions(PROJECT["dependencies"]) | set().union(*map(distributions, EXTRAS.values()))
    used = {CALLED.get(module, module) for module in modules}
    assert used - {"ray"} == asked  # 240 MB: users of a Ray cluster have it


def test_tests_have_every_extra() -> None:
    (dev,) = (text for text in PROJECT["optional-dependencies"]["dev"] if text.startswith("hpop["))
    assert set(dev.removeprefix("hpop[").rstrip("]").split(",")) == set(EXTRAS) - {"crowd"}  # brings 700 MB, unused


def test_all_that_is_asked_for_is_pinned() -> None:
    pinned = {line.partition("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().split()}
    everything = PROJECT["dependencies"] + [
        text for asked in PROJECT["optional-dependencies"].values() for text in asked
    ]
    assert distributions(everything) - {"hpop"} <= pinned


# The release


def test_the_version_is_one_and_the_changelog_begins_with_it() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == hpop.__version__
    (first, *_) = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert first == f"{hpop.__version__}, {cited['date-released']}"
