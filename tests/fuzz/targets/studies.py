"""Studies: designs, forms, answers; what was learnt of people."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from mutations import Rng, bent_bytes, bent_tree
from verdicts import verdict

import hpop
from hpop import study
from hpop.study.session import Session
from targets.fronts import saved_front
from targets.given import as_json, as_yaml, written
from tests.study.sessions import session

FORMS = Path(study.__file__).parent / "forms"
LEARNT = {
    "schema": "hpop-learnt",
    "version": 1,
    "parts": [{"criterion": {"turns": {}}, "weight": 1.5}, {"criterion": {"length": {}}, "weight": 0.25}],
    "learnt": {
        "question": "comfort", "source": "nobody", "ratings": 9, "people": 3, "trajectories": 5,
        "error": 0.5, "error_of_mean": 0.7,
    },
}  # fmt: skip


@cache
def asked() -> hpop.Front:
    """Return the front that participants see."""
    path = Path("asked.json")
    path.write_bytes(saved_front())
    front = hpop.Front.load(path)
    path.unlink()
    return front


@cache
def designed() -> study.Design:
    return study.Design.of(asked(), [0, 1], participants=4, consent="You may stop at any time.", seed=1)


def _bent(path: Path, text: str, rng: Rng) -> Path:
    """JSON with bent bytes or with other values."""
    if rng.random() < 0.3:
        path.write_bytes(bent_bytes(text.encode(), rng))
    else:
        path.write_bytes(as_json(bent_tree(json.loads(text), rng, most=2)).encode("utf-8", "surrogatepass"))
    return path


def design(rng: Rng, folder: Path) -> str:
    _bent(folder / "design.json", designed().document.decode(), rng)
    return verdict(lambda: repr(study.Design.load(folder)))


def form(rng: Rng, folder: Path) -> str:
    kinds = sorted(FORMS.glob("*.yaml"))
    tree: Any = yaml.safe_load(kinds[rng.integers(len(kinds))].read_text(encoding="utf-8"))
    path = written(folder / "form.yaml", tree, rng, as_yaml)
    return verdict(lambda: repr(study.Form.load(path)))


def answers(rng: Rng, folder: Path) -> str:
    """One session, bent, and the tables made of it."""
    path = _bent(folder / "p01.json", json.dumps(session(designed(), "p01")), rng)

    def read() -> None:
        found = Session.load(path, designed())
        repr(found)

    return verdict(read)


def preference(rng: Rng, folder: Path) -> str:
    path = folder / "p01.json"
    study.Preference.fit(asked(), [(0, 1), (1, 2)]).save(path)
    _bent(path, path.read_text(), rng)
    return verdict(lambda: study.Preference.load(path).best(asked()))


def learnt(rng: Rng, folder: Path) -> str:
    path = _bent(folder / "comfort.json", json.dumps(LEARNT), rng)
    return verdict(lambda: repr(hpop.criteria.make_criterion({"learnt": {"file": str(path)}})))
