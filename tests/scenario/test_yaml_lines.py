"""Scenario files are plain YAML: what is refused is refused with its line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hpop.errors import ScenarioError
from hpop.scenario.yaml_lines import MAX_BYTES, Document


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "scenario.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder: Path, text: str | bytes) -> str:
    with pytest.raises(ScenarioError) as error:
        Document(written(folder, text))
    return str(error.value)


def test_values_are_plain_and_every_key_and_entry_knows_its_line(tmp_path: Path) -> None:
    document = Document(written(tmp_path, "a:\n  b: [1,\n    2.5]\nc: text\n"))
    assert document.values == {"a": {"b": [1, 2.5]}, "c": "text"}
    path = tmp_path / "scenario.yaml"
    assert document.where(("a", "b")) == f"{path}, line 2, a.b"
    assert document.where(("a", "b", 1)) == f"{path}, line 3, a.b.1"
    assert document.where(()) == f"{path}, line 1"


def test_a_missing_key_is_placed_at_the_nearest_one_above_it(tmp_path: Path) -> None:
    document = Document(written(tmp_path, "x: 1\na:\n  b: 1\n"))
    assert document.where(("a", "gone", "deeper")).endswith(", line 2, a.gone.deeper")


def test_a_key_of_a_million_letters_does_not_fill_the_message(tmp_path: Path) -> None:
    document = Document(written(tmp_path, f"? {'x' * 1_000_000}\n: 1\n"))
    assert document.where(("x" * 1_000_000,)).endswith(f", line 1, {'x' * 200}...")


def test_a_key_is_a_word_also_where_yaml_would_read_true_or_false(tmp_path: Path) -> None:
    document = Document(written(tmp_path, "on: {no: 1, Yes: off}\n"))
    assert document.values == {"on": {"no": 1, "Yes": False}}
    assert document.where(("on", "no")).endswith(", line 1, on.no")


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("a: 1\nb: *x\n", 2, "the alias *x names nothing that ends before it"),
        ("a: 1\nb: &x [*x]\n", 2, "the alias *x names nothing that ends before it"),
        ("a: &x 1\nb: &x [*x]\n", 2, "the alias *x names nothing that ends before it"),
        ("a: 1\n\nb: !!python/object/apply:os.system ['exit']\n", 3, "python/object/apply:os.system"),
        ("a: !home 1\n", 1, "!home"),
        ("a: 1\nb: 2\na: 3\n", 3, "'a' is given twice"),
        ("a:\n  b: {c: 1, c: 1}\n", 2, "'c' is given twice"),
        ("a: 1\n7: 2\n", 2, "'7'"),
        ("a: 1\n~: 2\n", 2, "'~'"),
        ("a: 1\n? [1, 2]\n: 3\n", 2, "a list or keys"),
        ("a: 1\n? {b: 1}\n: 3\n", 2, "a list or keys"),
        ("a: 1\n<<: {b: 1}\n", 2, "'<<'"),
        ("a: [1, 2\n", 2, "not plain YAML"),
        ("a:\n\tb: 1\n", 2, "; indent with spaces, not tabs"),
        ("a: 1\n---\nb: 1\n", 2, "not plain YAML"),
        ("a: 010\n", 1, "'010'"),
        ("a: 1\nb: [2, 1:30]\n", 2, "'1:30'"),
        ("a: 0x1F\n", 1, "'0x1F'"),
        ("a: 1_000\n", 1, "'1_000'"),
        ("a: 1" + "0" * 5000 + "\n", 1, "plain decimal number"),
        ("a: " + "[" * 50_000 + "]" * 50_000, 1, "nested more than"),
        ("a: " + "{a: " * 30 + "1" + "}" * 30, 1, "nested more than"),
        ("a: 1\nb: 2020-13-45\n", 2, "timestamp"),
    ],
)
def test_what_is_not_plain_is_refused_with_file_and_line_once(tmp_path: Path, text: str, line: int, said: str) -> None:
    message = refusal(tmp_path, text)
    assert message.startswith(f"{tmp_path / 'scenario.yaml'}, line {line}: ")
    assert said in message
    assert message.count("scenario.yaml") == 1
    assert "\n" not in message


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "an empty file"),
        (b"# only a comment\n", "an empty file"),
        (b"- a\n- b\n", "['a', 'b']"),
        (b"hello", "'hello'"),
        (b"a: caf\xe9\n", "UTF-8"),
        ("a: 1\n".encode("utf-16"), "UTF-8"),
        (b"a: 1 # \x07\n", "control characters"),
        (b"\x00\x01", "not plain YAML"),
        (b"world\n  image: {path: plan.png}\n", "check that each key ends in a colon"),
        (b"model:\n    radius: 1\n  speed: 2\n", "check that each key ends in a colon"),
        (b"\x89PNG\r\n", "hpop new "),
    ],
)
def test_what_is_no_scenario_at_all_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    message = refusal(tmp_path, content)
    assert said in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "value"), [("1.5", 1.5), ("-3", -3), ("1.0e-3", 0.001), (".5", 0.5), ("+2.", 2.0), ("0", 0)]
)
def test_decimal_numbers_are_read(tmp_path: Path, text: str, value: float) -> None:
    assert Document(written(tmp_path, f"a: {text}\n")).values == {"a": value}


def test_infinite_numbers_are_left_for_the_schema_to_refuse(tmp_path: Path) -> None:
    assert Document(written(tmp_path, "a: -.inf\n")).values == {"a": float("-inf")}


def test_a_byte_order_mark_is_no_part_of_the_first_key(tmp_path: Path) -> None:
    assert Document(written(tmp_path, b"\xef\xbb\xbfworld: 1\n")).values == {"world": 1}


def test_a_missing_file_a_folder_and_a_pipe_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="no such file"):
        Document(tmp_path / "gone.yaml")
    with pytest.raises(ScenarioError, match="found a folder"):
        Document(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ScenarioError, match="found a FIFO"):
        Document(tmp_path / "pipe")
    with pytest.raises(ScenarioError, match="cannot be read"):
        Document(Path("nul\0byte"))
    with pytest.raises(ScenarioError, match="cannot be read"):
        Document(written(tmp_path, "a: 1") / "below")


def test_a_huge_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with (tmp_path / "huge.yaml").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(ScenarioError, match="at most"):
        Document(tmp_path / "huge.yaml")
