"""Command ``hpop live``: a page on which a viewer chooses where the robot goes, and drives."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpop import cli
from hpop.cli.terminal import echo, imports_option, user_errors

if TYPE_CHECKING:
    from hpop.live.server import LiveServer

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

PORT = 8020


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, metavar="N", help=f"Port to serve on. [{PORT}]")
@click.option("--network", is_flag=True, help="Serve other machines in the network too, over https: needs hpop[serve].")
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder of the record. [out/SCENARIO]")
@imports_option
@user_errors
def live(scenario: Path, port: int, network: bool, out: Path | None, imports: tuple[str, ...]) -> None:
    """Serve a live session: choose a destination, be offered ways, drive.

    SCENARIO is a YAML file; its robot starts at its start. One viewer drives, others watch. Every event is recorded.
    Runs until Ctrl-C.
    """
    serve(scenario, port=port, network=network, out=out, imports=imports)


def serve(scenario: Path, *, port: int, network: bool, out: Path | None, imports: Sequence[str]) -> None:
    """Serve a live session of a scenario until Ctrl-C, and print its addresses."""
    serving = cli.serving
    here = serving.own_address() if network else serving.LOCAL
    certificate = serving.certificate_for(here) if network else None
    with server_of(
        scenario,
        out or Path("out", scenario.stem),
        imports,
        port=port,
        host=serving.EVERYWHERE if network else serving.LOCAL,
        names=[here],
        secured=None if certificate is None else serving.context_of(certificate),
    ) as server:
        echo(f"drive: {server.address(here)}")
        echo(f"watch: {server.address(here, drives=False)}")
        if certificate is not None:
            echo(f"the browser warns of the certificate; its SHA-256 fingerprint is {certificate.fingerprint}")
        echo(f"record: {server.session.record.path}")
        server.serve_forever()


def server_of(scenario: Path, out: Path, imports: Sequence[str], **options: object) -> LiveServer:
    """Return the server of a live session, whose record is a new file in the folder ``out``."""
    from hpop.live.process import PlannerProcess
    from hpop.live.record import Record
    from hpop.live.scene import scene_of
    from hpop.live.server import LiveServer
    from hpop.live.session import LiveSession
    from hpop.scenario import load_scenario

    cli.user_code.register(imports)
    problem = load_scenario(scenario).problem
    name = time.strftime("live-%Y%m%dT%H%M%SZ.jsonl", time.gmtime())
    record = Record(out / name, {"scenario": str(scenario)})
    scene = scene_of(problem, scenario.stem)
    session = LiveSession(problem, scene, record, partial(PlannerProcess, scenario, imports))
    return LiveServer(session, **options)  # type: ignore[arg-type]
