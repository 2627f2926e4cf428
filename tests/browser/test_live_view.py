"""The view of a live session: a camera's MJPEG stream or WebRTC in its place, and the explorer beside it."""

from __future__ import annotations

import io
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Thread
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, expect

from hpop.cli.living import server_of
from tests.browser.test_live_page import ROOM, Guest

pytestmark = pytest.mark.proof
BROKEN = "() => new Promise((done) => addEventListener('securitypolicyviolation', (e) => done(e.blockedURI)))"


@contextmanager
def camera(colour: tuple[int, int, int]) -> Iterator[tuple[str, Event]]:
    """Serve an MJPEG stream of one colour; yield its address, and an event that ends the stream."""
    picture, ends = io.BytesIO(), Event()
    Image.new("RGB", (64, 48), colour).save(picture, "jpeg")

    class Camera(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            while not ends.wait(0.05):
                data = picture.getvalue()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode() + data + b"\r\n")
                except OSError:
                    return

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Camera) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/stream?key=1", ends
        ends.set()
        server.shutdown()
        thread.join()


@contextmanager
def guest_of(browser: Browser, folder: Path, **options: str) -> Iterator[Guest]:
    (folder / "room.yaml").write_text(ROOM)
    with server_of(folder / "room.yaml", folder / "out", **options) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        guest = Guest(browser, server.address())
        yield guest
        guest.close()
        server.shutdown()
        thread.join()
        assert server.session.record_path is not None
        assert "stream" not in server.session.record_path.read_text()
    assert guest.complaints == []


def test_a_video_stands_in_the_views_place_with_the_ways_over_it_and_no_other_origin_may_send_images(
    browser: Browser, tmp_path: Path
) -> None:
    with (
        camera((250, 10, 10)) as (address, _),
        camera((0, 0, 250)) as (other, _),
        guest_of(browser, tmp_path, video=address) as guest,
    ):
        page = guest.page
        page.wait_for_function("() => document.querySelector('#view img').naturalWidth === 64")
        guest.prepared()
        plain = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        red = plain.getpixel((200, 250))
        assert isinstance(red, tuple)
        assert red[0] > 200 > 60 > max(red[1:])
        guest.choose(6.0, 1.0)  # straight ahead: its line is on the floor of the view
        page.wait_for_timeout(500)
        ways = Image.open(io.BytesIO(page.screenshot())).convert("RGB").crop((0, 200, 400, 540))
        assert (np.asarray(ways)[:, :, 1] > 100).sum() > 100
        blocked = page.evaluate(
            f"""async (other) => {{
            const broken = ({BROKEN})();
            new Image().src = other;
            return await broken;
        }}""",
            other,
        )
        assert blocked.startswith(other.partition("?")[0].rpartition("/")[0])


WHEP = """
import asyncio, sys
import numpy as np
from aiohttp import web
from aiortc import RTCPeerConnection, RTCSessionDescription, VideoStreamTrack
from av import VideoFrame

class Camera(VideoStreamTrack):
    async def recv(self):
        frame = VideoFrame.from_ndarray(np.full((240, 320, 3), (250, 10, 10), np.uint8), "rgb24")
        frame.pts, frame.time_base = await self.next_timestamp()
        return frame

CORS = {"Access-Control-Allow-Origin": "*", "Access-Control-Allow-Headers": "*", "Access-Control-Allow-Methods": "*",
        "Access-Control-Expose-Headers": "Location"}
peers = []

async def offer(request):
    peer = RTCPeerConnection()
    peers.append(peer)
    await peer.setRemoteDescription(RTCSessionDescription(await request.text(), "offer"))
    peer.addTrack(Camera())
    await peer.setLocalDescription(await peer.createAnswer())
    headers = {**CORS, "Location": "/camera/whep/1"}
    return web.Response(status=201, text=peer.localDescription.sdp, content_type="application/sdp", headers=headers)

async def allow(request):
    return web.Response(headers=CORS)

async def lose(request):
    await asyncio.gather(*(peer.close() for peer in peers))
    return web.Response(text=str(len(peers)))

async def main():
    app = web.Application()
    app.add_routes([web.post("/camera/whep", offer), web.get("/lose", lose)])
    app.add_routes([web.route(verb, path, allow) for verb in ("OPTIONS", "DELETE")
                    for path in ("/camera/whep", "/camera/whep/1")])
    runner = web.AppRunner(app)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    print(site._server.sockets[0].getsockname()[1], flush=True)
    await asyncio.Event().wait()

asyncio.run(main())
"""
SHOWN = "() => document.querySelector('#view video').videoWidth === 320"


@contextmanager
def whep_camera() -> Iterator[str]:
    """Serve a red video by WHEP with aiortc, in the Python that HPOP_AIORTC_PYTHON names."""
    python = os.environ.get("HPOP_AIORTC_PYTHON")
    if not python:
        pytest.skip("HPOP_AIORTC_PYTHON names no Python with aiortc and aiohttp")
    with subprocess.Popen([python, "-c", WHEP], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield f"http://127.0.0.1:{server.stdout.readline().strip()}"
        finally:
            server.terminate()


def test_the_video_of_a_whep_address_stands_in_the_views_place_and_comes_again_when_it_was_lost(
    browser: Browser, tmp_path: Path
) -> None:
    with whep_camera() as address, guest_of(browser, tmp_path, video=f"whep+{address}/camera/whep") as guest:
        page = guest.page
        page.wait_for_function(SHOWN)
        expect(page.locator("#alarm")).to_be_hidden()
        page.wait_for_timeout(500)
        red = Image.open(io.BytesIO(page.screenshot())).convert("RGB").getpixel((200, 250))
        assert isinstance(red, tuple)
        assert red[0] > 200 > 60 > max(red[1:])
        asked = urlopen(f"{address}/lose").read()
        assert asked == b"1"
        expect(page.locator("#alarm")).to_contain_text("camera is lost")
        expect(page.locator("#alarm")).to_be_hidden()
        assert urlopen(f"{address}/lose").read() == b"2"


def test_the_explorer_shows_the_front_of_the_cards_to_those_who_may_drive(browser: Browser, tmp_path: Path) -> None:
    with guest_of(browser, tmp_path) as guest:
        guest.prepared()
        guest.choose(6.0, 4.0)
        ways = guest.of("options")[-1]["all"]
        with guest.page.expect_popup() as opened:
            guest.page.get_by_role("link", name="Explore").click()
        payload = opened.value.evaluate("() => JSON.parse(document.getElementById('payload').textContent)")
        assert payload["count"] == len(ways)
        assert [column["name"] for column in payload["columns"]][: len(ways[0]["costs"])] == list(ways[0]["costs"])
        expect(opened.value.locator("body")).to_contain_text(f"{len(ways)}")
