"""`hpop ride`: the page it writes, and how it is served: to who knows the token, over https if need be."""

from __future__ import annotations

import json
import re
import socket
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest
import shapely
from click.testing import Result
from cryptography import x509

import hpop
from hpop.cli.serving import Certificate, OnePage, certificate_for
from hpop.runtime.page_server import LOCAL

Run = Callable[..., Result]
PAGE = b"<p>a page</p>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = hpop.World.from_polygons([shapely.box(0, 0, 8, 0.2)], extent=shapely.box(0, 0, 8, 6))
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (3, 1, None), ["turns", "length"])
    ways = [[(1, 1, 0), (3, 1, 0)], [(1, 1, 0), (2, 2, 0), (3, 1, 0)], [(1, 1, 0)]]
    trajectories = [hpop.Trajectory.from_poses(problem.model, way) for way in ways]
    place = tmp_path_factory.mktemp("room")
    hpop.Front.of(
        [[1.0, 2.0], [2.0, 1.5], [3.0, 0.0]],
        trajectories,
        names=["turns", "length"],
        units=["1", "m"],
        problem=problem.describe(),
    ).save(place / "front.json")
    return place


def payload_of(page: Path) -> dict[str, object]:
    (text,) = re.findall(r'id="payload">(.*?)</script>', page.read_text(encoding="utf-8"))
    return json.loads(text)


@pytest.mark.parametrize("out", ["front.json", "", "."])
def test_the_front_does_not_give_way_to_its_page(run: Run, folder: Path, out: str) -> None:
    before = (folder / "front.json").read_bytes()
    result = run("ride", folder, "--out", out and folder / out)
    assert result.exit_code == 10
    assert "expected a file name that ends in .html" in " ".join(result.output.split())
    assert (folder / "front.json").read_bytes() == before


def test_the_page_has_the_rows_that_are_asked_for_as_a_b_c(run: Run, folder: Path) -> None:
    result = run("ride", folder, "--rows", "least length,0", "--rows", "knee")
    assert result.exit_code == 0, result.output
    told = " ".join(result.output.split())
    assert f"written: {folder / 'ride.html'}, to ride along" in told
    assert "A is least length (row 2)" in told
    assert "B is row 0" in told
    given = payload_of(folder / "ride.html")
    assert [track["name"] for track in given["tracks"]][:2] == ["A", "B"]
    assert given["tracks"][1]["duration"] == hpop.Front.load(folder / "front.json").trajectories[0].execution().duration
    assert "Permission is hereby granted" in given["licence"]


def test_a_blind_page_holds_no_numbers_of_criteria_and_no_names(run: Run, folder: Path, tmp_path: Path) -> None:
    assert run("ride", folder, "--rows", "0,1", "--blind", "--out", tmp_path / "it.html").exit_code == 0
    given = payload_of(tmp_path / "it.html")
    assert given["criteria"] == given["notes"] == []
    assert {(track["label"], track["rates"], *track["costs"]) for track in given["tracks"]} == {("", None)}
    assert "turns" not in json.dumps({**given, "licence": ""})


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--rows", "7"], 10, "the front has rows 0 to 2"),
        (["--rows", "best"], 7, "no row is called 'best'"),
        (["--serve", "--cable"], 2, "give only one of --serve and --cable"),
        (["--cable", "--out", "it.html"], 2, "a served page has no --out and no --open"),
        (["--video", "it.mp4", "--blind"], 2, "--video and --frames make no page"),
        (["--out", "/proc/nowhere/it.html"], 12, "the ride cannot be written to /proc/nowhere/it.html"),
    ],
)
def test_what_cannot_be_is_told(run: Run, folder: Path, arguments: list[str], code: int, said: str) -> None:
    result = run("ride", folder, *arguments)
    assert result.exit_code == code
    assert said in " ".join(result.output.split())


def test_a_folder_without_a_front_is_told(run: Run, tmp_path: Path) -> None:
    result = run("ride", tmp_path)
    assert result.exit_code == 12
    assert "give the folder that `hpop plan` wrote" in " ".join(result.output.split())


def test_a_port_that_is_in_use_is_told(run: Run, folder: Path) -> None:
    with socket.socket() as other:
        other.bind((LOCAL, 0))
        other.listen()
        result = run("ride", folder, "--cable", "--port", str(other.getsockname()[1]))
    assert result.exit_code == 12
    assert "another program uses it; end that program, or choose another --port" in " ".join(result.output.split())


@contextmanager
def serving(certificate: Certificate | None = None) -> Iterator[OnePage]:
    with OnePage(PAGE, host=LOCAL, port=0, certificate=certificate) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def test_the_page_is_served_to_who_knows_its_token_and_nothing_else_is() -> None:
    with serving() as server:
        address = server.address(LOCAL)
        with urllib.request.urlopen(address) as answer:
            assert answer.read() == PAGE
            assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        root = address.rsplit("/", 1)[0]
        for path in ("/", "/ride.html", "/..%2f..%2fetc/passwd", f"/{server.token[:-1]}", f"/{server.token}/x"):
            with pytest.raises(urllib.error.HTTPError) as refused, urllib.request.urlopen(root + path):
                pass
            assert refused.value.code == 404
            refused.value.close()
        with pytest.raises(urllib.error.HTTPError) as refused, urllib.request.urlopen(address, data=b"x"):
            pass
        assert refused.value.code == 405
        refused.value.close()


def test_over_https_the_certificate_is_that_of_the_address_and_of_no_other() -> None:
    certificate = certificate_for("192.0.2.7")
    with serving(certificate) as server:
        trusting = ssl.create_default_context(cadata=certificate.pem.decode())
        with urllib.request.urlopen(server.address(LOCAL), context=trusting) as answer:
            assert answer.read() == PAGE
        with socket.create_connection((LOCAL, server.server_address[1])) as silent:  # who says nothing keeps nobody
            assert silent.fileno() >= 0
            with urllib.request.urlopen(server.address("localhost"), context=trusting) as answer:
                assert answer.read() == PAGE
        with pytest.raises(urllib.error.URLError, match="CERTIFICATE_VERIFY_FAILED"):
            urllib.request.urlopen(server.address(LOCAL), context=ssl.create_default_context())
    named = x509.load_pem_x509_certificate(certificate.pem).extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    assert {str(ip) for ip in named.value.get_values_for_type(x509.IPAddress)} == {"192.0.2.7", LOCAL}


def test_nobody_is_asked_what_this_machine_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(socket, "getfqdn", asked.append)
    with OnePage(PAGE, host="0.0.0.0", port=0) as server:
        assert server.server_address[1] > 0
    assert asked == []


def test_two_pages_have_two_tokens() -> None:
    with serving() as one, serving() as other:
        assert one.token != other.token
        assert len(one.token) >= 12
