"""``armscope replay``: a recording over Zenoh once more, at its own pace."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, check_table
from armscope.commands.options import Json, RecordingArgument
from daq.recording import open_long
from daq.rig import Rig, read_rig
from daq.service import Publisher, blocks_of, keys_of, open_session, paced
from daq.service.commands import CommandServer

MAY_BE_INFINITE = ("--speed", "--wait")


def command(
    recording: RecordingArgument,
    speed: Annotated[
        float, typer.Option(metavar="X", help="speed relative to real time; inf: as fast as subscribers receive")
    ] = 1.0,
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="the endpoint of this rig; default: loopback")
    ] = None,
    endpoint: Annotated[str, typer.Option(metavar="ENDPOINT", help="another loopback endpoint")] = "tcp/127.0.0.1:7447",
    wait: Annotated[float, typer.Option(metavar="S", help="maximum time to wait for the first subscriber, s")] = 2.0,
    as_json: Json = False,
) -> None:
    if not speed > 0:
        raise InputError("--speed", f"must be above 0, or inf (is {speed:g})")
    if not wait >= 0:
        raise InputError("--wait", f"must be 0 or more, or inf (is {wait:g})")
    run = open_long(recording, damaged=True)
    table = _rig(run.rig.get("name") or "replay", run.layout.joints, endpoint) if rig is None else read_rig(rig)
    with open_session(table, listen=True) as session:
        keys = keys_of(run.rig.get("name") or table.name)
        publisher = Publisher(session, keys, run.layout.joints, reliable=True)
        server = CommandServer(session, keys)
        print(f"replaying {recording} on {table.zenoh.endpoint}, keys {keys.root}/**", file=sys.stderr, flush=True)
        watched = _await_subscriber(publisher, wait)
        began = time.monotonic()
        for _, block in paced(blocks_of(run), speed):
            publisher.publish(block)
            _refuse_all(server)
        publisher.finish()
        seconds = time.monotonic() - began
        server.close()
    figures = {"file": str(recording), "rows": publisher.rows, "blocks": publisher.blocks, "seconds": seconds}
    if as_json:
        print(json.dumps(figures | {"watched": watched, "lost": run.ledger.lost}))
    else:
        unwatched = "" if watched else "; no subscriber at the start"
        print(f"{publisher.rows} rows in {publisher.blocks} blocks, {seconds:.2f} s{unwatched}")


def _await_subscriber(publisher: Publisher, seconds: float) -> bool:
    deadline = time.monotonic() + (seconds if math.isfinite(seconds) else 1e9)
    while not publisher.watched and time.monotonic() < deadline:
        time.sleep(0.005)
    return publisher.watched


def _refuse_all(server: CommandServer) -> None:
    while (command := server.next(0)) is not None:
        command.refuse(InputError("replay", f"{command.verb}: this is a replay; it takes no commands"))


def _rig(name: str, joints: tuple[str, ...], endpoint: str) -> Rig:
    """A rig that is a name and a loopback endpoint: that of the recording may belong to another machine."""
    rig = check_table(
        "--endpoint",
        {"name": name, "joint": [{"name": joint} for joint in joints], "zenoh": {"endpoint": endpoint}},
        Rig,
    )
    if not rig.zenoh.loopback:
        raise InputError("--endpoint", "is not loopback; must be given by --rig, with a secured endpoint")
    return rig
