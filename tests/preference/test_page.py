"""The page about preferences: its Python runs, and finds the best row; its picture shows what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.preference import Preference
from hpop.view import draw_preference
from tests.view.explorer.fronts import seeded

PAGE = Path(__file__).parents[2] / "docs" / "preferences.md"


def test_the_first_example_finds_the_best_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    block = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert block
    names: dict[str, Any] = {}
    exec(block.group(1), names)
    front, person = names["front"], names["person"]
    weights = {"exposure": 20.0, "turns": 0.5, "length": 1.0}
    assert names["best"].row == int(np.argmin(front.costs @ [weights[name] for name in front.names]))
    assert Preference.load(tmp_path / "p07.json").answers == person.answers

    rows = list(range(0, len(front), 3))
    names |= {"other_front": front, "rows": rows, "who": ["p07"] * len(rows)}
    names["preferences"] = [Preference.fit(front, [(0, 1)], seed=seed) for seed in range(3)]
    names["profiles"] = [{"mssq": 12.5, "age_band": 3}, {"mssq": 4.0, "age_band": 2}, {"mssq": 1.0}]
    names["ratings"] = (-front.costs[rows, 1]).tolist()
    for later in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1:]:
        exec(later, names)
    assert (tmp_path / "comfort.json").exists()


def test_the_picture_shows_each_share_with_its_interval_and_the_best_row() -> None:
    problem, front = seeded(20)
    person = Preference.fit(front, [(0, 10), (0, 15)])
    left, right, *_ = draw_preference(problem, front, person).axes
    names = [label.get_text() for label in left.get_yticklabels()]
    assert sorted(names) == sorted(front.names)
    places, shares = left.lines[0].get_ydata(), left.lines[0].get_xdata()
    for place, share in zip(np.asarray(places).astype(int).tolist(), np.asarray(shares).tolist(), strict=True):
        assert share == pytest.approx(person.weights[names[place]])
    ends = [(segment[0][0], segment[1][0]) for segment in left.collections[0].get_segments()]  # type: ignore[attr-defined]
    assert ends == [pytest.approx(person.interval(0.9)[name]) for name in names]
    assert f"row {person.best().row}," in right.get_title()
    legend = right.get_legend()
    assert legend is not None
    assert any("for you" in text.get_text().replace("\N{NO-BREAK SPACE}", " ") for text in legend.get_texts())
