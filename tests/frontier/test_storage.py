from __future__ import annotations

import json
import os
import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hpop.frontier import FrontFileError, ItemFront, storage

finite = st.floats(allow_nan=False, allow_infinity=False)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | finite | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


def front_of(costs=((1.0, 0.1 + 0.2), (0.0, 2.5)), *, items=None, **changes):
    fields = {
        "reported": [[i / 3] for i in range(len(costs))],
        "provenance": [{"planner": "gewählt", "weights": (0.1, 0.9)} for _ in costs],
        "problem": {"start": [0.0, 1.5], "map": None},
        "runs": [{"planner": "lattice", "labels": 7}],
        **changes,
    }
    return ItemFront.of(
        costs,
        [{"x": [i]} for i in range(len(costs))] if items is None else items,
        names=("turns", "length"),
        units=("1", "m"),
        quanta=(1.0, 1e-6),
        groups=("C", "R"),
        status="complete",
        certificate="exact on this graph",
        reported_names=["duration"],
        reported_units=["s"],
        **fields,
    )


def contents(front):
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in vars(front).items()}


@pytest.fixture
def refuse_text(tmp_path):
    """Save a front, change the text of the file, and return the message of the refusal to load it."""

    def load_changed(change):
        path = tmp_path / "front.json"
        front_of().save(path)
        changed = change(path.read_text(encoding="utf-8"))
        path.write_bytes(changed if isinstance(changed, bytes) else changed.encode())
        with pytest.raises(FrontFileError) as caught:
            ItemFront.load(path)
        assert str(path) in str(caught.value)
        return str(caught.value)

    return load_changed


@pytest.fixture
def refuse(refuse_text):
    """Do the same with the JSON document in the file, which ``change`` changes in place."""

    def load_changed(change):
        def change_text(text):
            document = json.loads(text)
            change(document)
            return json.dumps(document)

        return refuse_text(change_text)

    return load_changed


def test_all_of_a_front_comes_back(tmp_path):
    front = front_of()
    front.save(tmp_path / "front.json")
    assert contents(ItemFront.load(tmp_path / "front.json")) == contents(front)


def test_an_empty_front_comes_back(tmp_path):
    front = front_of(costs=np.zeros((0, 2)))
    front.save(tmp_path / "front.json")
    assert contents(ItemFront.load(tmp_path / "front.json")) == contents(front)


@settings(max_examples=settings.default.max_examples // 2)
@given(
    st.lists(st.tuples(st.integers(0, 9), st.floats(-1e9, 1e9)), min_size=1, max_size=5),
    finite,
    json_values,
    st.dictionaries(st.text(max_size=3), json_values, max_size=3),
)
def test_numbers_items_and_provenance_come_back_exactly(tmp_path_factory, costs, value, item, origin):
    path = tmp_path_factory.mktemp("fronts") / "front.json"
    n = len(costs)
    front = front_of(costs, items=[item] * n, reported=[[value]] * n, provenance=[origin] * n, problem=origin)
    front.save(path)
    assert contents(ItemFront.load(path)) == contents(front)


def test_the_smallest_and_largest_floats_come_back(tmp_path):
    values = [5e-324, 1.7976931348623157e308, 0.1, 1 / 3]
    front = front_of([[float(i), -float(i)] for i in range(4)], reported=[[v] for v in values])
    front.save(tmp_path / "front.json")
    assert ItemFront.load(tmp_path / "front.json").reported.ravel().tolist() == values


@pytest.mark.parametrize("whole", [3000, 2**63, 10**300], ids=["3000", "2**63", "10**300"])
def test_whole_numbers_are_read_up_to_the_largest_float(tmp_path, whole):
    """As a program in another language may write them: "3000", not "3000.0"."""
    path = tmp_path / "front.json"
    front_of().save(path)
    path.write_text(path.read_text().replace("0.3333333333333333", str(whole)))
    assert ItemFront.load(path).reported.max() == whole


def test_a_codec_turns_items_into_json_and_back(tmp_path):
    front = front_of(items=[3 + 4j, 1j])
    front.save(tmp_path / "front.json", encode=lambda z: [z.real, z.imag])
    loaded = ItemFront.load(tmp_path / "front.json", decode=lambda pair: complex(*pair))
    assert loaded.items == front.items == (1j, 3 + 4j)


def test_the_problem_is_kept_beside_the_front(tmp_path):
    front_of(problem=None).save(tmp_path / "front.json", problem={"map": "museum.yaml"})
    assert ItemFront.load(tmp_path / "front.json").problem == {"map": "museum.yaml"}
    front_of().save(tmp_path / "front.json")
    assert ItemFront.load(tmp_path / "front.json").problem == front_of().problem


def test_half_a_surrogate_pair_as_in_names_of_files_comes_back(tmp_path):
    front_of(items=["\udcff"] * 2).save(tmp_path / "front.json")
    assert ItemFront.load(tmp_path / "front.json").items == ("\udcff",) * 2


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("item", [nested(10**5), object(), {1, 2}, float("nan"), {1: 0, "1": 0}])
def test_an_item_that_is_not_json_is_refused_and_the_old_file_stays(tmp_path, item):
    path = tmp_path / "front.json"
    path.write_text("old")
    with pytest.raises(FrontFileError, match="encode="):
        front_of(items=[item, item]).save(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["front.json"]


def test_nothing_half_written_is_left_when_the_disk_fails(tmp_path, monkeypatch):
    path = tmp_path / "front.json"
    path.write_text("old")

    def no_space(descriptor):
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(OSError, match="no space"):
        front_of().save(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["front.json"]


@pytest.mark.parametrize("place", ["missing/deeper/front.json", "file/front.json", "folder"])
def test_where_a_front_cannot_be_saved_the_error_names_no_temporary_file(tmp_path, place):
    (tmp_path / "file").write_text("text")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=re.escape(str((tmp_path / place).parent))) as caught:
        front_of().save(tmp_path / place)
    assert ".tmp" not in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_a_missing_folder_is_named_with_the_way_out(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"does not exist; make it first: '.*/missing'$"):
        front_of().save(tmp_path / "missing" / "front.json")


@pytest.mark.parametrize("path", [3, None, b"front.json"])
def test_what_is_no_path_is_refused(path):
    for use in (front_of().save, ItemFront.load):
        with pytest.raises(FrontFileError, match="path must be a string or a path object"):
            use(path)


def test_a_file_above_the_limit_is_neither_written_nor_read(tmp_path, monkeypatch):
    path = tmp_path / "front.json"
    front_of().save(path)
    size = path.stat().st_size
    monkeypatch.setattr(storage, "SIZE_LIMIT", size)
    front_of().save(path)
    assert len(ItemFront.load(path)) == 2
    monkeypatch.setattr(storage, "SIZE_LIMIT", size - 1)
    with pytest.raises(FrontFileError, match=f"at most {size - 1} bytes"):
        ItemFront.load(path)
    with pytest.raises(FrontFileError, match=r"must be at most .* bytes"):
        front_of().save(path)


def test_every_truncation_of_a_file_is_refused(tmp_path):
    path = tmp_path / "front.json"
    front_of().save(path)
    data = path.read_bytes()
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        with pytest.raises(FrontFileError, match=r"expected JSON.*save the front again"):
            ItemFront.load(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"status"', '"status": "x", "status"', "'status' twice"),
        ("0.30000000000000004", "NaN", "NaN"),
        ("0.30000000000000004", "-Infinity", "-Infinity"),
        ("0.30000000000000004", "1e999", "too large"),
        ("0.30000000000000004", "1" * 400, "range of float64 in costs.length"),
        ("0.30000000000000004", '"0.3"', "2 numbers in costs.length, found 2 of type float, str"),
        ("0.30000000000000004", "true", "2 numbers in costs.length, found 2 of type bool, float"),
        ("0.30000000000000004", "null", "2 numbers in costs.length, found 2 of type NoneType, float"),
        ('"labels": 7', f'"labels": {10**400}', "too large for float64"),
    ],
)
def test_what_strict_json_numbers_exclude_is_refused(refuse_text, old, new, message):
    assert message in refuse_text(lambda text: text.replace(old, new))


def test_other_files_are_refused(refuse, refuse_text):
    assert "JSON" in refuse_text(lambda text: b"\x80\x04N.")
    assert "JSON" in refuse_text(lambda text: b"\xff\xfe" + text.encode("utf-16-le"))
    assert "nested" in refuse_text(lambda text: "[" * 200_000)
    assert "found a JSON list" in refuse_text(lambda text: "[]")
    assert "schema None" in refuse_text(lambda text: "{}")
    assert "schema 'geo'" in refuse(lambda document: document.update(schema="geo"))


def test_a_newer_version_says_to_update(refuse):
    message = refuse(lambda document: document.update(version=3, anything="else"))
    assert "version 2, found version 3; update" in message
    for version in ("2", True, 2.0, 0, -(10**300), None):
        assert "save the front again" in refuse(lambda document, v=version: document.update(version=v))


def drop(mapping, key):
    del mapping[key]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda document: drop(document, "certificate"), "missing keys ['certificate']"),
        (lambda document: document.update(extra=1), "unknown keys ['extra']"),
        (lambda document: document.update(status=None), "'status' to be of type str"),
        (lambda document: document.update(runs=[7]), "runs[0] to be an object"),
        (lambda document: document.update(problem=[]), "'problem' to be of type dict or NoneType"),
        (lambda document: drop(document, "items"), "missing keys ['items']"),
        (lambda document: document.update(items=7), "'items' to be of type list or dict"),
        (lambda document: document["items"].append(7), "expected 2 entries in items, one for each point, found 3"),
        (lambda document: document["points"].update(count=3), "expected 3 entries in origin"),
        (lambda document: document["points"].update(count=10**300), "entries in origin"),
        (lambda document: document["points"].update(count=True), "'count' to be of type int"),
        (lambda document: document["points"].update(origins=[[]]), "origins[0] to be an object"),
        (lambda document: document["points"].update(origin=[0, 1]), "row numbers from 0 to 0 in origin"),
        (lambda document: document["points"].update(origin=[0, -1]), "row numbers from 0 to 0 in origin"),
        (lambda document: document["points"].update(origin=[0, 10**30]), "row numbers from 0 to 0 in origin"),
        (lambda document: document["points"].update(origin=[0, False]), "2 whole numbers in origin"),
        (lambda document: document["points"]["costs"]["turns"].append(1.0), "2 numbers in costs.turns, found 3"),
        (lambda document: document["points"]["reported"]["duration"].clear(), "2 numbers in reported.duration"),
        (lambda document: drop(document["points"]["costs"], "length"), "missing keys ['length']"),
        (lambda document: document["points"]["costs"].update(length={}), "'length' to be of type list"),
        (lambda document: document["criteria"][0].update(quantum=True), "'quantum' to be of type"),
        (lambda document: document["criteria"][0].update(quantum=0), "quanta must be positive"),
        (lambda document: document["criteria"][1].update(name="turns"), "unknown keys ['length']"),
        (lambda document: document["criteria"].append(document["criteria"][0]), "all different"),
        (lambda document: document["criteria"].clear(), "unknown keys ['length', 'turns']"),
        (lambda document: document["points"]["costs"]["turns"].reverse(), "must be sorted"),
        (
            lambda document: document["points"]["costs"].update(turns=[1.0, 1.0], length=[2.0, 2.0]),
            "must be sorted",
        ),
        (lambda document: document["points"]["costs"]["length"].__setitem__(1, 99.0), "must be sorted"),
        (lambda document: document.update(certificate=""), "what is proved"),
    ],
)
def test_a_document_that_is_not_a_front_is_refused(refuse, change, message):
    assert message in refuse(change)


def test_an_item_that_does_not_decode_names_its_point(tmp_path):
    path = tmp_path / "front.json"
    front_of().save(path)
    with pytest.raises(
        FrontFileError, match=r"points\[0\] cannot be decoded \(KeyError: 'y'\); pass the function decode="
    ):
        ItemFront.load(path, decode=lambda item: item["y"])


def test_a_missing_file_is_not_a_bad_front(tmp_path):
    with pytest.raises(FileNotFoundError):
        ItemFront.load(tmp_path / "absent.json")


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path, found in ((tmp_path / "fifo", "a FIFO"), ("/dev/zero", "a device"), (tmp_path, "a folder")):
        with pytest.raises(OSError, match=f"expected a regular file, found {found}"):
            ItemFront.load(path)


def test_what_points_share_is_written_once(tmp_path):
    n = 100
    front = front_of(np.stack([np.arange(n), -np.arange(n)], axis=1), provenance=[{"planner": "a" * 500}] * n)
    front.save(tmp_path / "front.json")
    assert (tmp_path / "front.json").read_text().count("a" * 500) == 1
    again = ItemFront.load(tmp_path / "front.json")
    assert again.provenance == front.provenance
    assert len({id(origin) for origin in again.provenance}) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda document: document["criteria"][0].update(name="a" * 10**5),
        lambda document: document["points"]["costs"].update({"a" * 10**5: []}),
        lambda document: document.update({"a" * 10**5: 1}),
        lambda document: document.update(version="a" * 10**5),
    ],
)
def test_what_a_file_says_at_length_is_cut(refuse, change):
    assert len(refuse(change)) < 1000


@pytest.mark.filterwarnings("ignore:.* is .* now:DeprecationWarning")
def test_a_front_pickled_under_the_former_names_of_its_classes_is_read():
    front = front_of()
    pickled = pickle.dumps([front, front[0]], protocol=0)
    former = pickled.replace(b"\nItemFront\n", b"\nFront\n").replace(b"\nItemPoint\n", b"\nPoint\n")
    assert former != pickled
    again, point = pickle.loads(former)
    assert contents(again) == contents(front)
    assert vars(point) == vars(front[0])
