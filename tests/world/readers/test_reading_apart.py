"""Claims: a file that would take all memory or time, or breaks what reads it, ends the process that reads it alone."""

import json
import os
import zlib
from pathlib import Path

import numpy as np
import pytest

from hpop.apart.child import ChildAnswer, ChildRefused, refusal, unpack
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.world import World, files
from hpop.world.readers.readers import reader_of
from tests.worlds import bag, dxf, grid, pdf, stream


def children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def test_each_format_is_read_in_another_process(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ezdxf.py").write_text("raise SystemExit('code of the current folder')")
    Path("plan.dxf").write_bytes(dxf(lambda d: d.modelspace().add_lwpolyline([(0, 0), (4, 0), (4, 3)])))
    Path("plan.pdf").write_bytes(pdf(b"0 0 m 400 0 l 400 300 l S"))
    bag(Path("walk"), {"/map": [grid(np.zeros((30, 40)), 0.1)]})
    before = children()
    for name, options in (("plan.dxf", {}), ("plan.pdf", {"scale": 0.01}), ("walk", {})):
        x0, y0, x1, y1 = World.from_file(name, **options).bounds
        assert (x1 - x0, y1 - y0) == pytest.approx((4, 3), abs=0.06)
    assert children() <= before


def test_a_bomb_is_refused_within_its_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "MEMORY", 300_000_000)
    packer = zlib.compressobj(1, wbits=-15)
    part = packer.compress(bytes(1_000_000)) + packer.flush(zlib.Z_FULL_FLUSH)
    packed = b"\x78\x01" + 300 * part + packer.flush()  # 300 MB in .3 MB; its end is not reached
    path = tmp_path / "plan.pdf"
    path.write_bytes(pdf(b"").replace(stream(b""), stream(packed, b"/Filter /FlateDecode")))
    with pytest.raises(MapError, match=r"plan\.pdf.*(crashed|memory|no lines|cannot be read)"):
        World.from_file(path, scale=0.01)


def test_what_takes_too_long_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "SECONDS", 1)
    path = tmp_path / "plan.pdf"
    path.write_bytes(pdf(b"".join(b"%d 0 m %d 300 l S\n" % (i % 400, i % 399) for i in range(100_000))))
    with pytest.raises(MapError, match="more than 1 s of processor time to read"):
        World.from_file(path, scale=0.01)


def test_a_limit_of_whoever_plans_ends_the_process(tmp_path):
    class Passed(limits.LimitPassed):
        pass

    class Soon:
        def check(self, doing, memory=0):
            raise Passed

        def hold(self, memory, doing):
            pass

    path = tmp_path / "plan.pdf"
    path.write_bytes(pdf(b"0 0 m 400 0 l 400 300 l S"))
    before = children()
    with pytest.raises(Passed), limits.within(Soon()):
        World.from_file(path, scale=0.01)
    assert children() <= before


def test_an_answer_is_numbers_and_words_and_nothing_else():
    answer = ChildAnswer({"layers": ["Ä"]}, {"points": np.arange(6.0).reshape(3, 2), "cells": np.zeros((2, 0), "|i1")})
    again = unpack(answer.packed())
    assert again.words == answer.words
    assert {name: array.tolist() for name, array in again.arrays.items()} == {
        name: array.tolist() for name, array in answer.arrays.items()
    }
    with pytest.raises(ChildRefused, match="no lines"):
        unpack(refusal("no lines"))
    for arrays in ([["points", "|O", [1]]], [["points", "<f8", [10**9]]], [["points", "<f8", [-1]]], 3):
        with pytest.raises((ValueError, TypeError)):
            unpack(json.dumps({"words": {}, "arrays": arrays}).encode() + b"\n" + bytes(8))


def test_a_reader_is_found_by_the_ending(tmp_path):
    named = {"a.geojson": "geojson", "b.DXF": "dxf", "c.pdf": "pdf", "d.PNG": "image", "e.yaml": "ros_map"}
    named |= {"f.map": "movingai", "g.mcap": "ros_bag"}
    assert {name: reader_of(name) for name in named} == named
    for inside in ("metadata.yaml", "walk.mcap"):  # a folder of a ROS 2 bag
        (tmp_path / inside).touch()
        assert reader_of(tmp_path) == "ros_bag"
        (tmp_path / inside).unlink()
    with pytest.raises(
        MapError, match=r"'plan.xyz': no reader .* give reader, one of commonroad, dxf, geojson, image, .*endings"
    ):
        World.from_file("plan.xyz")
    for path in (3, None, b"\x00"):
        with pytest.raises(MapError):
            World.from_file(path)
    (tmp_path / "plan.txt").write_text("{}")
    with pytest.raises(MapError, match="GeoJSON"):
        World.from_file(tmp_path / "plan.txt", reader="geojson")


def test_a_file_that_may_not_be_read_is_refused_with_what_to_check(monkeypatch):
    def closed(path, limit):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(files, "read_regular", closed)
    with pytest.raises(MapError, match=r"cannot be opened: Permission denied\. Check its permissions\.$"):
        files.read_bytes("plan.pdf", "map")
