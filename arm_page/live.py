"""The stream of a page: frames and state over a WebSocket, no faster than the browser draws them.

The browser acknowledges each message after drawing it (a hidden page does not). Two messages may be unacknowledged: the
next one has arrived when the last is drawn, so that every repaint has new frames. A slow browser gets fewer, larger
messages, and needs no memory: all browsers share one ring of frames (``arm_page.frames.Ring``).
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from arm_page.access import Access, Role
from arm_page.link import STATE_SECONDS, RigLink

DRAW_SECONDS = 0.02
"""s between pictures of the arm: 50 per second move evenly."""
AHEAD = 2
"""Maximum number of messages sent to a browser that it has not acknowledged."""
MOST_BYTES = 1000
"""Maximum size of a message from the browser."""


class Viewers:
    """All browsers that show a rig; ``close`` ends their streams."""

    def __init__(self, link: RigLink, access: Access, state: Callable[[], dict[str, Any]]) -> None:
        self._link, self._access, self._state = link, access, state
        self._encoded = ("", 0.0)
        self._tasks: set[asyncio.Task[Any]] = set()
        self._closing = False
        self.watching = self.steering = 0

    async def serve(self, socket: WebSocket) -> None:
        """Serves one browser: its first message is its token ('' for none), the others are acknowledgements."""
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
        """Ends all streams; must be called in the thread of the event loop."""
        self._closing = True
        for task in list(self._tasks):
            task.cancel()

    async def _stream(self, socket: WebSocket, token: str) -> None:
        """Sends until the browser has disconnected, or has lost the permission to watch."""
        free = asyncio.BoundedSemaphore(AHEAD)
        tasks = [asyncio.create_task(self._send(socket, token, free)), asyncio.create_task(_drawn(socket, free))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            task.result()

    async def _send(self, socket: WebSocket, token: str, free: asyncio.Semaphore) -> None:
        number, shown, run = 0, "", ""
        while True:
            await free.acquire()
            parts: list[str] = []
            while not parts:
                await asyncio.sleep(DRAW_SECONDS)
                if self._access.role(token) is None:
                    await socket.close(4401, "log in again")
                    return
                state = self._state_json()
                if state != shown:
                    parts.append(f'"state":{state}')
                    shown = state
                now_run, last, frames = self._link.frames.since(number)
                if frames or now_run != run:
                    parts.append(f'"run":{json.dumps(now_run)},"frames":[{",".join(frames)}]')
                    number, run = last, now_run
            await socket.send_text("{" + ",".join(parts) + "}")

    def _state_json(self) -> str:
        """The state, encoded once for all browsers."""
        text, made = self._encoded
        now = asyncio.get_running_loop().time()
        if not text or now - made >= STATE_SECONDS:
            text = json.dumps(self._state() | {"viewers": self.watching}, separators=(",", ":"))
            self._encoded = text, now
        return text


async def _drawn(socket: WebSocket, free: asyncio.BoundedSemaphore) -> None:
    """Permits a further message per acknowledgement of the browser; surplus acknowledgements are ignored."""
    while True:
        await socket.receive_text()
        with suppress(ValueError):
            free.release()
