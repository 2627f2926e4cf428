"""The committed bundles are those of the sources in web/: each names the hash of what it was made of."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WEB = ROOT / "web"
BUNDLES = sorted((ROOT / "hpop" / "view" / "web").glob("*.js"))


def hash_of_sources() -> str:
    """As web/build.mjs computes it."""
    files = [WEB / name for name in ("build.mjs", "package.json", "package-lock.json", "tsconfig.json")]
    files += [path for path in (WEB / "src").rglob("*") if path.is_file()]
    digest = hashlib.sha256()
    for name in sorted(path.relative_to(WEB).as_posix() for path in files):
        digest.update(name.encode() + b"\0" + (WEB / name).read_bytes() + b"\0")
    return digest.hexdigest()


def test_there_are_bundles() -> None:
    assert {path.name for path in BUNDLES} >= {"explorer.js", "live.js", "ride.js", "study.js", "widget.js"}


@pytest.mark.parametrize("bundle", BUNDLES, ids=lambda path: path.name)
def test_a_bundle_is_made_of_the_sources_that_are_here(bundle: Path) -> None:
    first = bundle.read_text(encoding="utf-8").split("\n", 1)[0]
    assert first == f"/* hpop, sources {hash_of_sources()} */", "run `make web` and commit hpop/view/web"


def test_the_lock_file_names_no_registry() -> None:
    assert "resolved" not in (WEB / "package-lock.json").read_text(encoding="utf-8")
