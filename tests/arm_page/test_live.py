"""The stream of one browser over the ASGI interface: how much it is sent before it has drawn anything."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
from starlette.websockets import WebSocket

from arm_page.access import Access
from arm_page.frames import FrameMaker, Ring
from arm_page.live import AHEAD, DRAW_SECONDS, Viewers


async def stream_of(answers: int, extra: int = 0) -> list[int]:
    """Messages with frames sent after 0, 1, ... answers, while a row comes every 20 ms; ``extra`` answers at first."""
    ring, maker = Ring(), FrameMaker(1, None)
    incoming: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
    sent: list[str] = []

    async def send(message: Any) -> None:
        if "frames" in message.get("text", ""):
            sent.append(message["text"])

    viewers = Viewers(SimpleNamespace(frames=ring), Access(), dict)  # type: ignore[arg-type]
    incoming.put_nowait({"type": "websocket.connect"})
    for text in ["", *["drawn"] * extra]:
        incoming.put_nowait({"type": "websocket.receive", "text": text})
    # the state goes with the first frames
    rows = [{"host_ns": np.array([20_000_000 * k]), "q": np.array([[0.1 * k]])} for k in range(1000)]
    ring.put("run", maker.add("run", rows[0]) + maker.add("run", rows[1]))
    serving = asyncio.create_task(viewers.serve(WebSocket({"type": "websocket"}, incoming.get, send)))
    counts = []
    for step in range(answers + 1):
        if step:
            incoming.put_nowait({"type": "websocket.receive", "text": "drawn"})
        for k in range(2, 10):
            ring.put("run", maker.add("run", rows[8 * step + k]))
            await asyncio.sleep(DRAW_SECONDS)
        counts.append(len(sent))
    incoming.put_nowait({"type": "websocket.disconnect", "code": 1001})
    await asyncio.wait_for(serving, 10)
    assert viewers.watching == 0
    return counts


def test_two_messages_are_on_their_way_and_each_answer_makes_room_for_one() -> None:
    assert AHEAD == 2
    assert asyncio.run(stream_of(3)) == [2, 3, 4, 5]


def test_answers_to_nothing_make_no_room() -> None:
    (count,) = asyncio.run(stream_of(0, extra=50))
    # one more than AHEAD: what is made ready is no longer counted, and not sent yet
    assert count <= AHEAD + 1
