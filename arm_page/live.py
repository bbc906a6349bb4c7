"""The stream of a page: frames and state over a WebSocket, as fast as the browser takes them and no faster.

The browser answers each message once it has drawn it (or, hidden, not at all); the next one is sent then. A slow
browser gets fewer, larger messages, and costs no memory: frames wait in one ring for all (``arm_page.frames.Ring``).
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from arm_page.access import Access, Role
from arm_page.link import RigLink

DRAW_SECONDS = 0.02
STATE_SECONDS = 0.25
MOST_BYTES = 1000
"""Of a message from the browser."""


class Viewers:
    """All browsers that look at a rig; ``close`` ends their streams."""

    def __init__(self, link: RigLink, access: Access, state: Callable[[], dict[str, Any]]) -> None:
        self._link, self._access, self._state = link, access, state
        self._encoded = ("", 0.0)
        self._tasks: set[asyncio.Task[Any]] = set()
        self._closing = False
        self.watching = self.steering = 0

    async def serve(self, socket: WebSocket) -> None:
        """One browser: its first message is its token ('' for none), the others acknowledge."""
        await socket.accept()
        try:
            async with asyncio.timeout(10):
                token = (await socket.receive_text())[:MOST_BYTES]
        except (TimeoutError, WebSocketDisconnect, KeyError):
            return
        role = self._access.role(token)
        if role is None:
            await socket.close(4401, "log in")
            return
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self.watching += 1
        self.steering += role is Role.STEER
        try:
            await self._stream(socket, token)
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass  # the browser has gone
        except asyncio.CancelledError:
            if not self._closing:
                raise
        finally:
            self._tasks.discard(task)
            self.watching -= 1
            self.steering -= role is Role.STEER

    def close(self) -> None:
        """Ends all streams; in the thread of the event loop."""
        self._closing = True
        for task in list(self._tasks):
            task.cancel()

    async def _stream(self, socket: WebSocket, token: str) -> None:
        number, shown, run = 0, "", ""
        while True:
            if self._access.role(token) is None:
                await socket.close(4401, "log in again")
                return
            parts = []
            state = self._state_json()
            if state != shown:
                parts.append(f'"state":{state}')
                shown = state
            now_run, last, frames = self._link.frames.since(number)
            if frames or now_run != run:
                parts.append(f'"run":{json.dumps(now_run)},"frames":[{",".join(frames)}]')
                number, run = last, now_run
            if parts:
                await socket.send_text("{" + ",".join(parts) + "}")
                await socket.receive_text()
            await asyncio.sleep(DRAW_SECONDS)

    def _state_json(self) -> str:
        """The state, encoded once for all browsers."""
        text, made = self._encoded
        now = asyncio.get_running_loop().time()
        if not text or now - made >= STATE_SECONDS:
            text = json.dumps(self._state() | {"viewers": self.watching}, separators=(",", ":"))
            self._encoded = text, now
        return text
