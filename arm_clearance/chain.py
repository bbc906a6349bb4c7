"""A serial arm as links that carry capsules: where they are, and how far a joint moves them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from arm_io.types import Array


@dataclass(frozen=True, kw_only=True)
class Body:
    """A capsule of link ``link`` (0: the base): all within ``radius`` m of the segment from ``start`` to ``end``.

    start, end (3,) m in the link's frame. assumed: not of the model, but taken from its kinematics.
    """

    link: int
    start: Array
    end: Array
    radius: float
    assumed: bool = False


@dataclass(frozen=True, kw_only=True)
class Chain:
    """n joints in a row and what their links look like.

    base           (4, 4) pose of frame 0 in the base frame
    before, after  (n, 4, 4): frame j in frame j - 1 is before J(q) after, J about (along) z
    coupling       (n, n): angles of the links = coupling q, of the joint positions q that are commanded and reported
    sliding        (n,) whether a joint is prismatic
    limits         (n, 2) rad (m): the poses that are looked at to see which links touch by design
    tool           (3,) m, the tool point in the frame of the last link
    bodies         of links 0 to n
    """

    base: Array
    before: Array
    after: Array
    coupling: Array
    sliding: tuple[bool, ...]
    limits: Array
    tool: Array
    bodies: tuple[Body, ...]

    def __len__(self) -> int:
        return len(self.sliding)

    def to_json(self) -> dict[str, Any]:
        """What a page needs to draw the arm: rad, m, matrices row by row."""
        return {
            "base": self.base.tolist(),
            "before": self.before.tolist(),
            "after": self.after.tolist(),
            "coupling": self.coupling.tolist(),
            "sliding": [bool(one) for one in self.sliding],
            "tool": self.tool.tolist(),
            "bodies": [
                {
                    "link": body.link,
                    "start": body.start.tolist(),
                    "end": body.end.tolist(),
                    "radius": body.radius,
                    "assumed": body.assumed,
                }
                for body in self.bodies
            ],
        }

    def frames(self, q: Array) -> Array:
        """(k, n + 1, 4, 4) poses of the links in the base frame for q (k, n)."""
        found, q = [np.broadcast_to(self.base, (len(q), 4, 4))], q @ self.coupling.T
        for j, sliding in enumerate(self.sliding):
            moved = np.zeros((len(q), 4, 4))
            moved[:] = np.eye(4)
            if sliding:
                moved[:, 2, 3] = q[:, j]
            else:
                moved[:, 0, 0] = moved[:, 1, 1] = np.cos(q[:, j])
                moved[:, 1, 0] = np.sin(q[:, j])
                moved[:, 0, 1] = -moved[:, 1, 0]
            found.append(found[-1] @ self.before[j] @ moved @ self.after[j])
        return np.stack(found, axis=1)

    def points(self, q: Array) -> Array:
        """(k, 2 bodies + 1, 3) m in the base frame: starts of the bodies, their ends, and the tool point."""
        frames = self.frames(q)[:, self._links]
        return np.asarray((frames[..., :3, :3] @ self._points[:, :, None])[..., 0] + frames[..., :3, 3])

    @cached_property
    def _links(self) -> list[int]:
        links = [body.link for body in self.bodies]
        return [*links, *links, len(self)]

    @cached_property
    def _points(self) -> Array:
        starts, ends = ([getattr(body, name) for body in self.bodies] for name in ("start", "end"))
        return np.array([*starts, *ends, self.tool], float)

    def reach(self, furthest: Array) -> Array:
        """(n, 2 bodies + 1): m that each of ``points`` moves at most per rad (m) of each link's own angle.

        In any pose whose prismatic joints stay within ``furthest`` (n,) m of their zero: no point is further from a
        joint's axis than the way to it along the links. A joint that comes after its link does not move it.
        """
        farthest = np.zeros((len(self), len(self._links)))
        slack = np.where(self.sliding, np.abs(self.coupling) @ furthest, 0.0)
        before, after = (np.linalg.norm(poses[:, :3, 3], axis=1) for poses in (self.before, self.after))
        for column, (link, point) in enumerate(zip(self._links, self._points)):
            way = float(np.linalg.norm(point))
            for j in range(link - 1, -1, -1):
                way += float(after[j])
                farthest[j, column] = 1.0 if self.sliding[j] else way
                way += float(before[j] + slack[j])
        return farthest
