"""The page of one rig, served until it is told to stop."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import signal
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError, read_file
from arm_page.access import Access, hosts_of
from arm_page.analyses import Analyses, Analysis
from arm_page.experiments import Experiments
from arm_page.link import RigLink
from arm_page.recordings import Recordings
from arm_page.scene import chain_of_rig, scene_of
from arm_page.steering import Steering
from daq.rig import read_rig

if TYPE_CHECKING:
    import uvicorn

NICE = 5
"""Drawing gives way to the sampler."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page to be served.

    rig          the rig file
    recordings   the folder of recordings, results in ``results`` below it
    experiments  folders of experiments that may be chosen
    port         on 127.0.0.1; 0: any
    """

    rig: Path
    recordings: Path
    experiments: Sequence[Path]
    analyses: Sequence[Analysis] = ()
    port: int = 8700

    def serve(self, ready: Callable[[str, str], None]) -> None:
        """Serves until SIGINT or SIGTERM. ``ready`` gets the address to steer and the one to watch.

        InputError: the rig file or its model is wrong, or the packages of the extra 'page' are missing. DeviceFault:
        the port is taken.
        """
        uvicorn = _installed()
        from arm_page.application import Parts, Server

        rig = read_rig(self.rig, drivers=False)
        chain = chain_of_rig(rig)
        link = RigLink(rig)
        access = Access()
        recordings, experiments = Recordings(self.recordings), Experiments(self.experiments)
        parts = Parts(
            scene=scene_of(rig, chain),
            link=link,
            access=access,
            experiments=experiments,
            recordings=recordings,
            analyses=Analyses(self.analyses, rig.model_path, recordings.folder / "results"),
            steering=Steering(link, experiments, recordings, chain, hashlib.sha256(read_file(self.rig)).hexdigest()),
        )
        with contextlib.suppress(OSError):
            os.nice(NICE)
        listener = _listener("127.0.0.1", self.port)
        port = listener.getsockname()[1]
        server = Server(parts, hosts_of("127.0.0.1", port), secure=False)
        config = uvicorn.Config(
            server.application,
            log_level="warning",
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=1 << 16,
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        link.open()
        try:
            ready(f"http://127.0.0.1:{port}/#{access.key}", f"http://127.0.0.1:{port}/")
            _run(uvicorn.Server(config), server.viewers.close, listener)
        finally:
            parts.analyses.close()
            link.close()
            listener.close()


def _run(server: uvicorn.Server, close_streams: Callable[[], None], listener: socket.socket) -> None:
    """Until a signal; the streams are ended first, or the server would wait for browsers that stay."""

    async def until_told() -> None:
        loop = asyncio.get_running_loop()
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.01)

        def end(number: int, _: object) -> None:
            server.should_exit = True
            loop.call_soon_threadsafe(close_streams)

        # After those of uvicorn, which raise the signal again once it has ended.
        before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            await serving
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    asyncio.run(until_told())


def _installed() -> Any:
    """The package uvicorn; InputError where the extra 'page' is not installed."""
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
        return socket.create_server((host, port))
    except OSError as error:
        raise DeviceFault("page", f"cannot listen on {host}:{port}: {error.strerror}; --port takes another") from None
