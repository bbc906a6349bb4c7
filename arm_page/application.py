"""Requests that the page's server answers: files, data, commands, stream. The page loads nothing from elsewhere."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from arm_io import DeviceFault, InputError
from arm_page.access import Access, Role
from arm_page.analyses import Analyses
from arm_page.archive import FolderArchive
from arm_page.experiments import Experiments
from arm_page.fleets import Fleets
from arm_page.guard import Guarded, failed, refusal
from arm_page.link import RigLink
from arm_page.live import Viewers
from arm_page.recordings import Recordings
from arm_page.steering import Steering
from arm_report.vendor import VENDOR

Table = dict[str, Any]
STATIC = Path(__file__).parent / "static"
MOST_BODY = 1 << 16
"""Bytes of a request at most: the longest is an experiment."""
REPORT_POLICY = (
    "sandbox allow-scripts allow-popups; default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; frame-ancestors 'self'"
)


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of the server that the requests use."""

    scene: Table
    meshes: Sequence[Path]
    link: RigLink
    access: Access
    experiments: Experiments
    recordings: Recordings
    archive: FolderArchive
    fleets: Fleets
    analyses: Analyses
    steering: Steering


class Server:
    """Answers the requests of all browsers; ``application`` is the ASGI application."""

    def __init__(self, parts: Parts, hosts: frozenset[str], *, secure: bool) -> None:
        self._parts = parts
        # stop never waits behind a preview or an arming robot
        self._stopping = ThreadPoolExecutor(2, thread_name_prefix="stop")
        self._working = ThreadPoolExecutor(8, thread_name_prefix="work")
        self.viewers = Viewers(parts.link, parts.access, self.state)
        routes = [
            Route("/", lambda request: FileResponse(STATIC / "index.html")),
            Route("/api/login", self._login, methods=["POST"]),
            Route("/api/rig", self._rig),
            Route("/api/mesh/{number:int}", self._mesh),
            Route("/api/experiments", self._experiments),
            Route("/api/preview/{name}", self._preview),
            Route("/api/command/{verb}", self._command, methods=["POST"]),
            Route("/api/devices", self._devices),
            Route("/api/recordings", self._recordings),
            Route("/api/recordings/{name}", self._recording),
            Route("/api/archive", self._archive),
            Route("/api/archive/entry", self._entry),
            Route("/api/archive/history", self._history),
            Route("/api/archive/pictures", self._pictures),
            Route("/api/analyses", self._begin, methods=["POST"]),
            Route("/api/analyses/{job}/stop", self._stop_analysis, methods=["POST"]),
            Route("/api/fleets", self._fleets),
            Route("/reports/{job}", self._report),
            Route("/fleets/{fleet}/{name:path}", self._fleet),
            WebSocketRoute("/api/live", self.viewers.serve),
            Mount("/static/charts", StaticFiles(directory=VENDOR)),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        inner = Starlette(routes=routes, lifespan=self._life, exception_handlers={Exception: failed})
        self.application: ASGIApp = Guarded(inner, hosts, secure=secure)

    @contextlib.asynccontextmanager
    async def _life(self, application: Starlette) -> AsyncIterator[None]:
        yield
        self._stopping.shutdown(wait=False)
        self._working.shutdown(wait=False, cancel_futures=True)

    def state(self) -> Table:
        """The variable data of the page: state of the daemon, telemetry of the rows, analyses."""
        link = self._parts.link
        return {
            "daemon": link.status,
            "why": link.why if link.status is None else None,
            "telemetry": link.telemetry(),
            "analyses": self._parts.analyses.list(),
        }

    # Requests

    async def _login(self, request: Request) -> Response:
        try:
            table = await _body(request)
        except InputError as error:
            return refusal(error)
        address = request.client.host if request.client else ""
        token = self._parts.access.log_in(str(table.get("user", "")), str(table.get("password", "")), address)
        if token is None:
            return refusal(InputError("login", "user or password is wrong; after a mistake wait a second"), 401)
        return JSONResponse({"token": token})

    async def _rig(self, request: Request) -> Response:
        role = self._parts.access.role(_token(request))
        if role is None:
            return refusal(InputError("login", "is required"), 401)
        known = self._parts.analyses.known.values()
        analyses = [{"name": a.name, "title": a.title, "help": a.help, "needs_points": a.needs_points} for a in known]
        log_in = self._parts.access.passwords is not None
        return JSONResponse(self._parts.scene | {"role": role, "login": log_in, "analyses": analyses})

    async def _mesh(self, request: Request) -> Response:
        """The file of a mesh of the scene, by its number in the scene."""
        number = request.path_params["number"]
        if self._parts.access.role(_token(request)) is None:
            return refusal(InputError("login", "is required"), 401)
        if number >= len(self._parts.meshes):
            return refusal(InputError("mesh", "there is no mesh of that number"), 404)
        return FileResponse(self._parts.meshes[number])

    async def _experiments(self, request: Request) -> Response:
        return await self._answer(request, Role.WATCH, self._parts.experiments.list)

    async def _preview(self, request: Request) -> Response:
        name = request.path_params["name"]
        return await self._answer(request, Role.WATCH, lambda: self._parts.steering.preview(name))

    async def _command(self, request: Request) -> Response:
        verb = request.path_params["verb"]
        try:
            arguments = await _body(request)
        except InputError as error:
            return refusal(error)
        pool = self._stopping if verb == "stop" else self._working
        return await self._answer(request, Role.STEER, lambda: self._parts.steering.command(verb, arguments), pool=pool)

    async def _devices(self, request: Request) -> Response:
        return await self._answer(request, Role.WATCH, lambda: self._parts.link.ask("identity"))

    async def _recordings(self, request: Request) -> Response:
        def listed() -> list[Table]:
            self._parts.recordings.follow((self._parts.link.status or {}).get("recordings"))
            return self._parts.recordings.list()

        return await self._answer(request, Role.WATCH, listed)

    async def _recording(self, request: Request) -> Response:
        name = request.path_params["name"]
        return await self._answer(request, Role.WATCH, lambda: self._parts.recordings.details(name))

    async def _archive(self, request: Request) -> Response:
        query = dict(request.query_params)
        return await self._answer(request, Role.WATCH, lambda: self._parts.archive.rows(query))

    async def _entry(self, request: Request) -> Response:
        path = request.query_params.get("path", "")
        return await self._answer(request, Role.WATCH, lambda: self._parts.archive.entry(path))

    async def _pictures(self, request: Request) -> Response:
        paths = request.query_params.getlist("path")
        idle = (self._parts.link.status or {}).get("state", "idle") == "idle"
        return await self._answer(request, Role.WATCH, lambda: self._parts.archive.pictures(paths, draw=idle))

    async def _history(self, request: Request) -> Response:
        query = dict(request.query_params)
        name = query.pop("parameter", "")
        return await self._answer(request, Role.WATCH, lambda: self._parts.archive.history(name, query))

    async def _fleets(self, request: Request) -> Response:
        return await self._answer(request, Role.WATCH, self._parts.fleets.list)

    async def _begin(self, request: Request) -> Response:
        def begun() -> Table:
            known = self._parts.recordings
            fit, held = ([known.path(name) for name in _names(table, key)] for key in ("recordings", "held_out"))
            if not fit:
                raise InputError("recordings", "is empty; must name one at least")
            return self._parts.analyses.begin(str(table.get("name")), fit, held)

        try:
            table = await _body(request)
        except InputError as error:
            return refusal(error)
        return await self._answer(request, Role.STEER, begun)

    async def _stop_analysis(self, request: Request) -> Response:
        job = request.path_params["job"]
        return await self._answer(request, Role.STEER, lambda: self._parts.analyses.stop(job))

    async def _report(self, request: Request) -> Response:
        """A report in a frame, which sends no token: the unguessable name of job or report is the permission."""
        name = request.path_params["job"]
        try:
            analysed = self._parts.analyses.holds(name)
            path = self._parts.analyses.report(name) if analysed else self._parts.archive.report(name)
        except InputError as error:
            return refusal(error, 404)
        return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})

    async def _fleet(self, request: Request) -> Response:
        """A page of a fleet, with permission as in ``_report``."""
        try:
            path = self._parts.fleets.file(request.path_params["fleet"], request.path_params["name"])
        except InputError as error:
            return refusal(error, 404)
        return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})

    async def _answer(
        self, request: Request, least: Role, work: Callable[[], Any], *, pool: ThreadPoolExecutor | None = None
    ) -> Response:
        """Result of ``work``, run on a thread, if the client has permission; otherwise one typed error."""
        role = self._parts.access.role(_token(request))
        if role is None:
            return refusal(InputError("login", "is required"), 401)
        if least is Role.STEER and role is not Role.STEER:
            return refusal(InputError("page", "you may watch, not steer; open the address with the key"), 403)
        try:
            result = await asyncio.get_running_loop().run_in_executor(pool or self._working, work)
        except (InputError, DeviceFault) as error:
            return refusal(error)
        return JSONResponse(result)


def _token(request: Request) -> str:
    kind, _, token = request.headers.get("authorization", "").partition(" ")
    return token if kind.lower() == "bearer" else ""


async def _body(request: Request) -> Table:
    """The JSON object of a request. InputError: it is no JSON object, or it is too long."""
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > MOST_BODY:
            raise InputError("request", f"is longer than {MOST_BODY} bytes")
    try:
        table = json.loads(data or b"{}")
    except (ValueError, RecursionError):
        table = None
    if not isinstance(table, dict):
        raise InputError("request", "must be a JSON object")
    return table


def _names(table: Table, key: str) -> list[str]:
    names = table.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or len(names) > 20:
        raise InputError(key, "must be a list of at most 20 names")
    return names
