"""Checks before every request: host and origin, content-security policy, and one typed error per failure."""

from __future__ import annotations

import logging
import traceback
from pathlib import Path
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from arm_io import DeviceFault, InputError

_LOG = logging.getLogger(__name__)
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Guarded:
    """Refuses requests under a foreign host name or from a foreign page, and sets the content-security policy.

    An unexpected exception in a request becomes one line of the log.
    """

    def __init__(self, inner: ASGIApp, hosts: frozenset[str], *, secure: bool) -> None:
        self._inner, self._hosts = inner, hosts
        schemes = ("https",) if secure else ("http",)
        self._origins = {f"{scheme}://{host}" for scheme in schemes for host in hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        origin = headers.get(b"origin")
        foreign = headers.get(b"host", "").lower() not in self._hosts or (
            origin is not None and origin not in self._origins and origin != "null"
        )
        if foreign or (origin == "null" and scope["type"] == "websocket"):
            await self._refuse(scope, receive, send)
            return

        async def sent(message: Any) -> None:
            if message["type"] == "http.response.start":
                names = {name for name, _ in message["headers"]}
                extra = {
                    b"content-security-policy": POLICY.encode(),
                    b"x-content-type-options": b"nosniff",
                    b"referrer-policy": b"no-referrer",
                    b"cache-control": b"no-store",
                }
                message["headers"] = [*message["headers"], *((k, v) for k, v in extra.items() if k not in names)]
            await send(message)

        try:
            await self._inner(scope, receive, sent)
        except ClientDisconnect:
            pass  # there is no client to answer
        except Exception as error:
            if scope["type"] == "websocket":
                raise
            # a defect of ours: Starlette has sent failed and raises again, of which uvicorn would log a traceback
            _LOG.error("%s %s failed: %s", scope["method"], ascii(scope["path"]), _in_one_line(error))
            _LOG.debug("in full:", exc_info=error)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403})
            return
        answer = refusal(InputError("page", "was requested under a host name that is not its own"), 403)
        await answer(scope, receive, send)


def refusal(error: InputError | DeviceFault, status: int = 409) -> Response:
    """An error as JSON: kind of error, where, what."""
    where = error.where if isinstance(error, InputError) else error.device
    kind = "input" if isinstance(error, InputError) else "device"
    return JSONResponse({"error": kind, "where": str(where), "what": error.what}, status_code=status)


def failed(request: Request, error: Exception) -> Response:
    """Answer to a request with an unexpected exception; the log has the details."""
    return JSONResponse({"error": "page", "where": "page", "what": "failed; its log says why"}, status_code=500)


def _in_one_line(error: Exception) -> str:
    """Exception and place in one line."""
    *_, last = traceback.extract_tb(error.__traceback__)
    return f"{type(error).__name__}: {str(error)!a} ({Path(last.filename).name}:{last.lineno})"
