"""Serves the page of one rig until a signal ends it."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import signal
import socket
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError, read_file
from arm_model.visuals import read_visuals
from arm_page.access import Access, hosts_of
from arm_page.analyses import Analyses, Analysis
from arm_page.archive import FolderArchive
from arm_page.experiments import Experiments
from arm_page.fleets import Fleets
from arm_page.link import RigLink
from arm_page.recordings import Recordings
from arm_page.scene import chain_of_rig, scene_of
from arm_page.steering import Steering
from daq.rig import Rig, read_passwords, read_rig

if TYPE_CHECKING:
    import uvicorn

    from arm_page.application import Parts

NICE = 5
"""Increase of the nice value, so that the sampler has priority over drawing."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page to be served.

    rig          the rig file
    recordings   the folder of recordings, results in ``results`` below it
    experiments  folders of experiments that may be chosen
    port         0: any free port; None: that of the rig file, which also has host, TLS, users and passwords
    """

    rig: Path
    recordings: Path
    experiments: Sequence[Path]
    analyses: Sequence[Analysis] = ()
    port: int | None = None

    def __post_init__(self) -> None:
        """InputError where the packages of the extra 'page' are missing: before a daemon is started for the page."""
        _installed()

    def serve(self, ready: Callable[[str, str], None]) -> None:
        """Serves until SIGINT or SIGTERM; calls ``ready`` with the addresses for steering and for watching.

        InputError: the rig file or its model is wrong. DeviceFault: the port is taken.
        """
        uvicorn = _installed()
        from arm_page.application import Server

        rig = read_rig(self.rig, drivers=False)
        link, access = RigLink(rig), _access(rig)
        parts = self._parts(rig, link, access)
        with contextlib.suppress(OSError):
            os.nice(NICE)
        listener = _listener(rig.page.host, rig.page.port if self.port is None else self.port)
        port = listener.getsockname()[1]
        hosts = hosts_of(rig.page.host, port, rig.page.names)
        server = Server(parts, hosts, secure=rig.page.tls is not None)
        config = uvicorn.Config(
            server.application,
            log_level="warning",
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=1 << 16,
            server_header=False,
            timeout_graceful_shutdown=2,
            **_tls(rig),
        )
        link.open()
        try:
            name = f"[{rig.page.host}]" if ":" in rig.page.host else rig.page.host
            address = f"{'http' if rig.page.tls is None else 'https'}://{name}:{port}/"
            steer = address if access.passwords is not None else f"{address}#{access.key}"
            _run(uvicorn.Server(config), server.viewers.close, listener, lambda: ready(steer, address))
        finally:
            parts.analyses.close()
            link.close()
            listener.close()

    def _parts(self, rig: Rig, link: RigLink, access: Access) -> Parts:
        """The parts of the application for this rig."""
        from arm_page.application import Parts

        chain = chain_of_rig(rig)
        visuals = read_visuals(rig.model_path) if rig.model_path is not None else ()
        recordings, experiments = Recordings(self.recordings), Experiments(self.experiments)
        return Parts(
            scene=scene_of(rig, chain, visuals),
            meshes=[visual.file for visual in visuals],
            link=link,
            access=access,
            experiments=experiments,
            recordings=recordings,
            archive=FolderArchive(recordings),
            fleets=Fleets(recordings),
            analyses=Analyses(self.analyses, rig.model_path, recordings.folder / "results"),
            steering=Steering(link, experiments, recordings, chain, hashlib.sha256(read_file(self.rig)).hexdigest()),
        )


def _access(rig: Rig) -> Access:
    """Access control of the rig file; InputError if 'steer' names a user without a password."""
    if rig.page.password_file is None:
        return Access()
    path = rig.resolve(rig.page.password_file)
    passwords = read_passwords(path)
    for user in rig.page.steer:
        if user not in passwords:
            raise InputError(path, f"has no line '{user}:PASSWORD' for a user of 'page.steer' of the rig file")
    return Access(passwords, rig.page.steer)


def _tls(rig: Rig) -> dict[str, str]:
    """Files for TLS, as arguments of uvicorn."""
    if rig.page.tls is None:
        return {}
    files = {"ssl_certfile": rig.page.tls.certificate, "ssl_keyfile": rig.page.tls.key}
    paths = {name: rig.resolve(path) for name, path in files.items()}
    for path in paths.values():
        if not os.path.isfile(path):
            raise InputError(path, "no such file; 'page.tls' of the rig file names it")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(paths["ssl_certfile"], paths["ssl_keyfile"])
    except (ssl.SSLError, OSError) as error:
        raise InputError(paths["ssl_certfile"], f"cannot be used with {paths['ssl_keyfile']}: {error}") from None
    return {name: str(path) for name, path in paths.items()}


def _run(
    server: uvicorn.Server, close_streams: Callable[[], None], listener: socket.socket, ready: Callable[[], None]
) -> None:
    """Serves until a signal; calls ``ready`` first. Ends the streams first, or the server would wait for browsers."""
    # uvicorn raises every signal again once it has ended, and what is to be closed after it would stay open
    server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign,assignment]
    loop = asyncio.new_event_loop()

    def end(number: int, _: object) -> None:
        server.should_exit = True
        loop.call_soon_threadsafe(close_streams)

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        ready()
        loop.run_until_complete(server.serve(sockets=[listener]))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        loop.close()


def _installed() -> Any:
    """The package uvicorn; InputError if the extra 'page' is not installed."""
    try:
        import starlette  # noqa: F401
        import uvicorn
        import websockets  # noqa: F401
    except ImportError as error:
        raise InputError(
            "page", f"needs the package {error.name}, which is not installed; pip install 'armscope[page]'"
        ) from None
    return uvicorn


def _listener(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise DeviceFault("page", f"cannot listen on {host}:{port}: {error.strerror}; --port takes another") from None
