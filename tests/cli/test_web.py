"""`hpop show --web` writes the page of a front beside it, `--open` opens it; a new front takes an old page away."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

import hpop
from hpop.cli import results
from hpop.view import save_pictures
from tests.view.explorer.decoder import held
from tests.view.explorer.fronts import seeded


@pytest.fixture
def saved(plan: Callable[..., Result], room: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    with monkeypatch.context() as patched:  # pictures are tested elsewhere
        patched.setattr("hpop.view.save_pictures", lambda problem, front, folder, **options: [])
        patched.setattr("hpop.view.save_explorer", lambda problem, front, path, **options: Path(path))
        plan(room)
    return room / "out"


def test_web_writes_the_page_beside_the_front_and_names_it(run: Callable[..., Result], saved: Path) -> None:
    result = run("show", saved, "--web", "--also", "rotation")
    assert result.exit_code == 0
    assert f"written: {saved / 'front.html'}" in result.stdout
    page = held(saved / "front.html")
    assert list(page.columns) == ["turns", "length", "rotation"]
    assert page.raw["saved"] == "front.json"


def test_without_web_no_page_is_written(run: Callable[..., Result], saved: Path) -> None:
    assert run("show", saved).exit_code == 0
    assert not (saved / "front.html").exists()


def browser(folder: Path, code: int) -> str:
    """Return a browser command, as the environment names one, that records the address it opens."""
    script = folder / "browser.py"
    script.write_text(f"import sys; open({str(folder / 'opened')!r}, 'w').write(sys.argv[1]); sys.exit({code})")
    return f"{sys.executable} {script} %s"


def test_open_opens_it_in_the_users_browser(
    run: Callable[..., Result], saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import webbrowser

    monkeypatch.setattr(webbrowser, "_tryorder", None)  # asked anew
    monkeypatch.setattr(webbrowser, "_browsers", {})
    monkeypatch.setenv("BROWSER", browser(tmp_path, 0))
    result = run("show", saved, "--open")
    assert (result.exit_code, result.stderr) == (0, "")
    assert (tmp_path / "opened").read_text() == (saved / "front.html").as_uri()


def test_where_there_is_no_browser_the_page_is_written_and_named(
    run: Callable[..., Result], saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import webbrowser

    monkeypatch.setattr(webbrowser, "_tryorder", None)
    monkeypatch.setattr(webbrowser, "_browsers", {})
    monkeypatch.setenv("BROWSER", browser(tmp_path, 1))
    monkeypatch.setenv("PATH", str(tmp_path))  # nothing else that opens pages is found
    monkeypatch.delenv("DISPLAY", raising=False)
    result = run("show", saved, "--open")
    assert result.exit_code == 0
    assert f"open {saved / 'front.html'} in one yourself" in result.stderr
    assert (saved / "front.html").exists()


def test_a_new_front_takes_the_page_of_an_old_one_away(tmp_path: Path) -> None:
    (tmp_path / "front.html").write_text("of an old front")
    results.save(seeded(3)[1], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["front.json"]
    assert len(hpop.Front.load(tmp_path / "front.json")) == 3


def test_a_folder_in_the_place_of_the_page_is_told_before_planning(plan: Callable[..., Result], room: Path) -> None:
    (room / "out" / "front.html").mkdir(parents=True)
    result = plan(room)
    assert result.exit_code == 12
    assert "front.html: it is a folder; remove it" in result.stderr


def test_a_page_that_fails_costs_neither_the_front_nor_the_pictures(
    plan: Callable[..., Result], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*arguments: object, **options: object) -> Path:
        raise ValueError("no room")

    monkeypatch.setattr("hpop.view.save_explorer", fails)
    few = {"dpi": 40, "map_alone": True}
    monkeypatch.setattr("hpop.view.save_pictures", lambda *given, **options: save_pictures(*given, **options | few))
    result = plan(room)
    assert result.exit_code == 12
    assert "front.html is not: ValueError('no room')" in result.stderr
    assert {path.name for path in (room / "out").iterdir()} == {"front.json", "map.png"}
