"""Which distances are looked at, and how much of each is left beyond what must be kept.

Left out, as in MoveIt's semantic descriptions (SRDF): links that are neighbours, links that touch in the zero pose or
in ``ALWAYS`` of the poses within their limits, and what no motion changes (a base that stands on the floor).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm_clearance.chain import Chain
from arm_clearance.distances import segment_to_box, segment_to_segment
from arm_clearance.space import Space
from arm_io.types import Array

POSES, ALWAYS = 400, 0.95
"""Random poses that are looked at; the share of them in which links touch that are made to touch (MoveIt's)."""
UNCHANGED = 1e-9
"""m."""
ROWS = 2048
"""Poses whose distances are computed together."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Distances of an arm in its space: P of them.

    floor       indices into ``Chain.points``: ends of capsules that stay above the floor
    boxes       (body, box) of links that stay out of boxes
    links       (body, body) of links that stay clear of one another, the lower link first
    touching    (link, link) that are left out because they touch by design
    """

    chain: Chain
    space: Space
    floor: tuple[int, ...] = ()
    boxes: tuple[tuple[int, int], ...] = ()
    links: tuple[tuple[int, int], ...] = ()
    touching: tuple[tuple[int, int], ...] = ()

    def __len__(self) -> int:
        return len(self.floor) + len(self.boxes) + len(self.links) + self._walled

    @property
    def _walled(self) -> bool:
        return self.space.low is not None or self.space.high is not None

    def names(self) -> list[tuple[str, str]]:
        """What each distance is between."""
        bodies, boxes = self.chain.bodies, self.space.box
        link = [_name(body.link) for body in bodies]
        found = [(link[point % len(bodies)], "the floor") for point in self.floor]
        found += [(link[body], f"box '{boxes[box].name}'") for body, box in self.boxes]
        found += [(link[one], link[other]) for one, other in self.links]
        return found + [("the tool point", "the limits of [space]")] * self._walled

    def required(self) -> Array:
        """(P,) m of each distance that must be kept: the margin, 0 of the tool point within its limits."""
        return np.array([self.space.margin] * (len(self) - self._walled) + [0.0] * self._walled)

    def clearance(self, q: Array) -> Array:
        """(k, P) m: distances between surfaces for joint positions q (k, n); negative where they overlap.

        Of a capsule's axis in a box or crossing another only that it overlaps is known, not how deep.
        """
        blocks = [self._clearance(q[first : first + ROWS]) for first in range(0, len(q), ROWS)]
        return np.concatenate(blocks) if blocks else np.empty((0, len(self)))

    def _clearance(self, q: Array) -> Array:
        points, bodies, space = self.chain.points(q), self.chain.bodies, self.space
        count, radius = len(bodies), np.array([body.radius for body in bodies])
        clearances = []
        if self.floor:
            chosen = np.array(self.floor)
            clearances.append(points[:, chosen, 2] - radius[chosen % count] - (space.floor or 0.0))
        if self.boxes:
            body, box = np.array(self.boxes).T
            low, high = (
                np.array([getattr(one, corner) for one in space.box], float)[box] for corner in ("low", "high")
            )
            clearances.append(segment_to_box(points[:, body], points[:, count + body], low, high) - radius[body])
        if self.links:
            one, other = np.array(self.links).T
            apart = segment_to_segment(
                points[:, one], points[:, count + one], points[:, other], points[:, count + other]
            )
            clearances.append(apart - radius[one] - radius[other])
        if self._walled:
            low = np.array(space.low if space.low is not None else [-np.inf] * 3)
            high = np.array(space.high if space.high is not None else [np.inf] * 3)
            clearances.append(np.minimum(points[:, -1] - low, high - points[:, -1]).min(axis=1, keepdims=True))
        return np.concatenate(clearances, axis=1) if clearances else np.empty((len(q), 0))

    def rates(self, furthest: Array) -> Array:
        """(P, n) m by which each distance changes at most per rad (m) of each joint (``Chain.reach``)."""
        reach = self.chain.reach(furthest)
        count, joints = len(self.chain.bodies), np.arange(len(self.chain))
        of_body = np.maximum(reach[:, :count], reach[:, count:-1])
        found = [reach[:, point] for point in self.floor]
        found += [of_body[:, body] for body, _ in self.boxes]
        # Joints up to the lower link move both alike.
        found += [np.where(joints >= self.chain.bodies[one].link, of_body[:, other], 0.0) for one, other in self.links]
        of_links = np.array(found + [reach[:, -1]] * self._walled).reshape(len(self), len(self.chain))
        return np.asarray(of_links @ np.abs(self.chain.coupling))


def pairs_of(chain: Chain, space: Space) -> Pairs:
    """The distances that must be looked at."""
    bodies = chain.bodies
    moving = [k for k, body in enumerate(bodies) if body.link > 0]
    low, high = chain.limits.T
    random = np.random.default_rng(0)
    zero = np.clip(np.zeros((1, len(chain))), low, high)
    poses = np.concatenate([zero, low + (high - low) * random.random((POSES, len(chain)))])
    pairs = Pairs(
        chain=chain,
        space=space,
        floor=tuple(k + end for end in (0, len(bodies)) for k in moving) if space.floor is not None else (),
        boxes=tuple((k, box) for k in moving for box in range(len(space.box))),
        links=tuple(
            (one, other)
            for one, first in enumerate(bodies)
            for other, second in enumerate(bodies)
            if space.self_collision and second.link - first.link > 1
        ),
    )
    room = pairs.clearance(poses)
    changing = np.ptp(room, axis=0) > UNCHANGED
    counts = np.cumsum([len(pairs.floor), len(pairs.boxes)])
    of_floor, of_boxes, _ = np.split(changing, counts)[:3]
    between = room[:, counts[1] : counts[1] + len(pairs.links)]
    touch = (between[0] < 0.0) | ((between < space.margin).mean(axis=0) > ALWAYS)
    kept = replace(
        pairs,
        floor=tuple(one for one, changes in zip(pairs.floor, of_floor) if changes),
        boxes=tuple(one for one, changes in zip(pairs.boxes, of_boxes) if changes),
    )
    links = {pair: (bodies[pair[0]].link, bodies[pair[1]].link) for pair in pairs.links}
    together = sorted({links[pair] for pair, touches in zip(pairs.links, touch) if touches})
    return replace(
        kept,
        links=tuple(pair for pair in pairs.links if links[pair] not in together),
        touching=tuple(together),
    )


def _name(link: int) -> str:
    return f"link {link}" if link else "the base"
