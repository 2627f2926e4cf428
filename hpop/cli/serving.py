"""Web pages that the command line serves: one page to a headset, and the questions of ``hpop prefer --web``.

Headsets show pages in VR only over a secure connection: https with a temporary certificate, or http from their own
127.0.0.1, which `adb reverse` connects to a port of this machine. Only the page is served, and only to requests that
carry the token and address this machine by one of its names.

The page of questions asks a person which of two trajectories is better. It has plain HTML forms without scripts, and is
served to this machine only. Requests need the token in its address, and pages of other origins cannot answer. Each
answer carries the number of its question, so that an answer that is sent twice counts once.
"""

from __future__ import annotations

import datetime
import html
import ipaddress
import secrets
import socket
import ssl
from base64 import b64encode
from collections.abc import Callable, Sequence
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, NamedTuple, Protocol
from urllib.parse import parse_qs

from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from hpop.base.text import printable
from hpop.cli.terminal import echo
from hpop.errors import OutputError
from hpop.runtime.interrupts import waited
from hpop.runtime.page_server import LOCAL as LOCAL
from hpop.runtime.page_server import PageServer, body

if TYPE_CHECKING:
    from hpop.cli.page_words import PageWords
    from hpop.cli.picking import Difference


EVERYWHERE = "0.0.0.0"
DAYS = 7
"""Days for which a certificate is valid."""


class Certificate(NamedTuple):
    """Self-signed certificate for some IP addresses, with its private key (both PEM) and its SHA-256 fingerprint."""

    pem: bytes
    key: bytes
    fingerprint: str


class OnePage(PageServer):
    """Server of one page, at an address that contains a secret token.

    page   HTML, as bytes
    names  further names of this machine that requests may use
    """

    def __init__(
        self, page: bytes, *, host: str, port: int, names: Sequence[str] = (), certificate: Certificate | None = None
    ) -> None:
        super().__init__(
            [Route("/", lambda request: HTMLResponse(page))],
            host=host,
            port=port,
            names=names,
            token=secrets.token_urlsafe(9),
            secured=None if certificate is None else context_of(certificate),
        )

    def address(self, host: str) -> str:
        """Return the address of the page, as typed into a browser."""
        return f"{self.root(host)}/{self.token}"


def serve_headsets(server: PageServer, certificate: Certificate | None, begins: str) -> None:
    """Print how a headset trusts or reaches a server, then ``begins``, and serve until Ctrl-C."""
    if certificate is None:
        on_cable = f"tcp:{server.server_address[1]}"
        echo(f"for a headset on a cable, run first: adb reverse {on_cable} {on_cable}")
    else:
        echo("browsers warn once about the certificate, which hpop has signed itself; its SHA-256 is")
        echo(f"  {certificate.fingerprint}")
    echo(begins)
    with suppress(KeyboardInterrupt):
        server.serve_forever()


def own_address() -> str:
    """Return the IP address of this machine in its network, or 127.0.0.1 without a network. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address of documentation (RFC 5737)
            return str(probe.getsockname()[0])
        except OSError:
            return LOCAL


def certificate_for(*hosts: str) -> Certificate:
    """Create a self-signed certificate for IP addresses; browsers warn about it once.

    Raises OutputError if `cryptography` is not installed.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise OutputError(
            f"https needs the package cryptography, which is missing ({error}); pip install 'hpop[serve]', or use a "
            "headset on a cable (hpop ride --cable), which needs no https"
        ) from None
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "hpop ride")])
    now = datetime.datetime.now(datetime.UTC)
    addresses = [x509.IPAddress(ipaddress.ip_address(host)) for host in dict.fromkeys((*hosts, LOCAL))]
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # clocks differ
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost"), *addresses]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    return Certificate(
        made.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
        made.fingerprint(hashes.SHA256()).hex(":").upper(),
    )


def context_of(certificate: Certificate) -> ssl.SSLContext:
    """Return an SSL context with a certificate and its key.

    Python's ssl module reads keys only from files, so a temporary file holds it meanwhile, which
    only its owner may read.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with TemporaryDirectory(prefix="hpop-") as folder:
        paths = [Path(folder) / name for name in ("certificate.pem", "key.pem")]
        for path, data in zip(paths, (certificate.pem, certificate.key), strict=True):
            path.write_bytes(data)
        context.load_cert_chain(str(paths[0]), str(paths[1]))
    return context


MOST_BYTES = 1_000
"""Largest size of an answer, bytes."""
POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
"""Content security policy: the sources from which the page may load."""
# Trajectories a and b have the first two line colours and dashes of the map.
STYLE = """body{font:17px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1b1b1b}
body{background:#fff}table{border-collapse:collapse;margin:1rem 0}td,th{padding:.3rem .9rem .3rem 0;text-align:right}
td:first-child,td:last-child,th:first-child{text-align:left}td:last-child{color:#555}img{max-width:100%;max-height:60vh}
button{font:inherit;padding:.6rem 1.2rem;margin:.3rem .5rem .3rem 0;border:1px solid #555;border-radius:.4rem}
button{background:#fff;color:#1b1b1b;cursor:pointer}button:focus-visible{outline:3px solid #1a6fb0}
form{position:sticky;bottom:0;background:#fff;padding:.3rem 0}button{min-height:44px}h1{font-size:1.6rem}
button.main{background:#1a6fb0;color:#fff;border-color:#1a6fb0}
p.legend{font-size:.85rem;color:#555;margin:.3rem 0}
th.a{border-bottom:3px solid #000}th.b{border-bottom:3px dashed #d55e00}
@media(max-width:560px){body{margin:.5rem auto}h1{font-size:1.25rem}table{margin:.5rem 0}td{font-size:.9rem}
form{padding:.5rem 0;display:grid;grid-template-columns:1fr 1fr;gap:.5rem}
button{margin:0}}"""
ANSWERS = ("a", "b", "tie", "stop")


class Questionnaire(Protocol):
    """Interface between the page and a series of questions: the current question with its picture, or the result.

    texts        texts of the page, in the participant's language
    number       of the current question, from 1
    words        text of the current question
    is_over      whether no question is left
    differences  costs of the two trajectories of the current question, compared
    picture      PNG file: a map of both trajectories
    result       lines of text for the end
    answer       saves "a", "b" or "tie" and goes on to the next question; "stop" ends the questions
    """

    @property
    def texts(self) -> PageWords: ...
    @property
    def number(self) -> int: ...
    @property
    def words(self) -> str: ...
    @property
    def is_over(self) -> bool: ...
    def differences(self) -> list[Difference]: ...
    def picture(self) -> bytes: ...
    def result(self) -> list[str]: ...
    def answer(self, word: str) -> None: ...


def page_of(questions: Questionnaire) -> str:
    """Return the HTML page: the current question with map, table and buttons, or the result after the last question."""
    texts = questions.texts
    if questions.is_over:
        result = "".join(f"<p>{html.escape(printable(line))}</p>" for line in [*questions.result(), texts.say("close")])
        return f"{_head(texts)}<h1>{html.escape(texts.say('thanks'))}</h1>{result}"
    rows = "".join(
        "<tr>"
        + "".join(f"<td>{html.escape(printable(cell))}</td>" for cell in (cost.label, cost.a, cost.b, cost.words))
        + "</tr>"
        for cost in questions.differences()
    )
    image = b64encode(questions.picture()).decode()
    buttons = "".join(
        f"<button name=answer value={word}{kind}>{html.escape(texts.say(word))}</button>"
        for word, kind in zip(ANSWERS, (" class=main", " class=main", "", ""), strict=True)
    )
    return (
        f"{_head(texts)}<h1>{html.escape(questions.words)}</h1>"
        f"<img alt='{html.escape(texts.say('map'))}' src='data:image/png;base64,{image}'>"
        f"<p class=legend>{html.escape(texts.say('legend'))}</p>"
        "<table><tr><td aria-hidden=true></td><th class=a scope=col>a</th><th class=b scope=col>b</th>"
        f"<td aria-hidden=true></td></tr>{rows}</table>"
        f"<form method=post><input type=hidden name=question value={questions.number}>{buttons}</form>"
    )


def _head(texts: PageWords) -> str:
    """Return the beginning of every page."""
    return (
        f"<!doctype html><html lang={texts.language}><meta charset=utf-8><meta name=viewport "
        f"content='width=device-width'><title>{html.escape(texts.say('title'))}</title><style>{STYLE}</style><main>"
    )


def _page_of_loss(texts: PageWords, why: str, address: str) -> str:
    """Return the HTML page which says that an answer could not be saved; a link leads back to the same question."""
    said = html.escape(texts.say("lost", reason=printable(why)))
    way_back = f"<p><a href={address}>{html.escape(texts.say('again'))}</a></p>"
    return f"{_head(texts)}<h1>{html.escape(texts.say('again_title'))}</h1><p>{said}</p>{way_back}"


def serve(questions: Questionnaire, port: int, say: Callable[[str], None]) -> None:
    """Serve the page until the last question is answered and the browser has received the result.

    ``say`` prints a line. Raises OutputError if the port is taken.
    """
    token, lock, over = secrets.token_urlsafe(16), Lock(), Event()

    def show(request: Request) -> Response:
        """Return the page. Once the page with the result has been sent, the command ends."""
        with lock:
            page = page_of(questions)
            ends = BackgroundTask(over.set) if questions.is_over else None
        return HTMLResponse(page, headers={"Content-Security-Policy": POLICY}, background=ends)

    def answer(word: str, number: str) -> None:
        with lock:
            if word in ANSWERS and number == str(questions.number) and not questions.is_over:
                questions.answer(word)

    async def take(request: Request) -> Response:
        """Save the answer from a submitted form, and redirect to the page with the next question."""
        data = await body(request, MOST_BYTES)
        if data is None:
            return Response(status_code=HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        given = parse_qs(data.decode("ascii", "replace"))
        try:
            await run_in_threadpool(answer, given.get("answer", [""])[0], given.get("question", [""])[0])
        except OutputError as error:
            say(str(error))
            page = _page_of_loss(questions.texts, str(error), f"/{token}")
            return HTMLResponse(page, HTTPStatus.INTERNAL_SERVER_ERROR, {"Content-Security-Policy": POLICY})
        return RedirectResponse(f"/{token}", HTTPStatus.SEE_OTHER)

    routes = [Route("/", show), Route("/", take, methods=["POST"])]
    with PageServer(routes, port=port, token=token) as server:
        serving = Thread(target=server.serve_forever, daemon=True)
        serving.start()
        try:
            say(f"the questions are at {server.root()}/{token}")
            waited(over)
        finally:
            server.shutdown()
            serving.join()
