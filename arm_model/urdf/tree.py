"""The links of a URDF file as a tree: the chain of joints to the tip, and what it passes by."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from arm_io import InputError
from arm_model.branches import ends_that_move, joints_of_arm

TOOL_FRAME = "tool0"
"""Link at the end of an arm, without anything mounted on it, in the files of ROS-Industrial."""


def robot_of(path: str | Path, text: str | bytes) -> xml.Element:
    """The <robot> of a URDF file; InputError where it is none.

    Prefixes such as ``drake:`` are part of the names and need no declaration, as readers of URDF elsewhere have it.
    """
    builder, parser = xml.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except (ValueError, LookupError, expat.ExpatError) as error:  # LookupError: an unknown encoding
        raise InputError(path, f"cannot be read as URDF: {error}") from None
    robot = builder.close()
    if robot.tag != "robot":
        raise InputError(path, f"is <{robot.tag}>, not a URDF <robot>")
    return robot


@dataclass(frozen=True)
class Tree:
    """The links by name, and per link the joint above it and those below it."""

    path: str | Path
    links: dict[str, xml.Element]
    above: dict[str, xml.Element]
    below: dict[str, list[xml.Element]]

    @staticmethod
    def of(path: str | Path, robot: xml.Element) -> Tree:
        """InputError where the joints do not make trees."""
        links = _by_name(path, robot)
        above: dict[str, xml.Element] = {}
        below: dict[str, list[xml.Element]] = {name: [] for name in links}
        for joint in robot.findall("joint"):
            child, parent = (link_at(path, joint, end) for end in ("child", "parent"))
            for end in (child, parent):
                if end not in links:
                    raise InputError(path, f"joint {joint.get('name')!r}: no link {end!r}")
            if child in above:
                raise InputError(path, f"link {child!r} has two parents; expected a tree")
            above[child] = joint
            below[parent].append(joint)
        return Tree(path, links, above, below)

    def chain(self, tip: str | None) -> list[xml.Element]:
        """Joints from the root to ``tip``, else to the one that ``tip_of`` finds. InputError where there is none."""
        link = self.tip_of() if tip is None else tip
        if link not in self.links:
            raise InputError(self.path, f"no link {link!r}")
        chain: list[xml.Element] = []
        while link in self.above:
            if len(chain) == len(self.above):
                raise InputError(self.path, f"link {link!r} is behind itself; expected a tree")
            chain.append(self.above[link])
            link = link_at(self.path, chain[-1], "parent")
        return chain[::-1]

    def tip_of(self) -> str:
        """The end of the arm among the chains of moving joints: ``joints_of_arm``.

        Of several links fixed there ``tool0``, else the first; where a hand has none, the link that its fingers are on.
        InputError where the file does not decide.
        """
        ends = [name for name, joints in self.below.items() if not joints]
        chains = [self._moving(self.chain(name)) for name in ends]
        moving = ends_that_move(chains)
        count = joints_of_arm(chains)
        if len(ends) == 1:
            return ends[0]
        if not ends:
            raise InputError(
                self.path, "has no <link> that ends a chain of joints; xacro files need: xacro FILE > ARM.urdf"
            )
        if count is None:
            names = ", ".join(self.named_end(chains[index]) for index in moving) or ", ".join(self.links)
            raise InputError(
                self.path, f"branches into {names}; name the tip: armscope model FILE --tip LINK --out ARM.toml"
            )
        arm = chains[moving[0]][:count]
        if arm not in chains:
            return link_at(self.path, chains[moving[0]][count], "parent")
        return self.named_end(arm)

    def named_end(self, moving: Sequence[xml.Element]) -> str:
        """Of the ends behind the last of a chain's moving joints ``tool0``, else the first."""
        ends = self.ends(moving)
        return TOOL_FRAME if TOOL_FRAME in ends else ends[0]

    def ends(self, chain: Sequence[xml.Element]) -> list[str]:
        """The links without any below them behind the last moving joint of a chain."""
        moving = self._moving(chain)
        return [name for name, below in self.below.items() if not below and self._moving(self.chain(name)) == moving]

    def _moving(self, chain: Sequence[xml.Element]) -> list[xml.Element]:
        return [one for one in chain if _moves(one)]

    def names(self, chain: Sequence[xml.Element]) -> list[str]:
        """The links along a chain from its root on."""
        if not chain:
            return [next(iter(self.links), "")] if self.links else []
        return [link_at(self.path, chain[0], "parent")] + [link_at(self.path, joint, "child") for joint in chain]

    def beside(self, link: str, chain: Sequence[xml.Element]) -> list[xml.Element]:
        """The joints below a link that are not on the chain: fixed ones, behind the arm's first joint also others."""
        moves = self.moves(link)
        return [one for one in self.below[link] if one not in chain and (moves or not _moves(one))]

    def moves(self, link: str) -> bool:
        """Whether there is a moving joint between the root and a link."""
        return bool(self._moving(self.chain(link)))

    def moving_beside(self, chain: Sequence[xml.Element]) -> list[xml.Element]:
        """The first moving joint of every branch beside the chain."""
        found, open_links = [], self.names(chain)
        while open_links:
            for joint in self.below[open_links.pop(0)]:
                if joint in chain:
                    continue
                if _moves(joint):
                    found.append(joint)
                else:
                    open_links.append(link_at(self.path, joint, "child"))
        return found

    def behind(self, joint: xml.Element) -> list[str]:
        """All links behind a joint."""
        link = link_at(self.path, joint, "child")
        return [link, *(name for one in self.below[link] for name in self.behind(one))]


def _by_name(path: str | Path, robot: xml.Element) -> dict[str, xml.Element]:
    """The links by name; InputError where two have the same."""
    links: dict[str, xml.Element] = {}
    for link in robot.findall("link"):
        name = link.get("name", "")
        if name in links:
            raise InputError(path, f"has two links of the name {name!r}; the name of every link must be its own")
        links[name] = link
    return links


def link_at(path: str | Path, joint: xml.Element, end: str) -> str:
    """Name of the link at the ``parent`` or ``child`` end of a joint; InputError where there is none."""
    found = joint.find(end)
    if found is None or found.get("link") is None:
        raise InputError(path, f"<joint name={joint.get('name')!r}> needs <{end} link=...>")
    return str(found.get("link"))


def _moves(joint: xml.Element) -> bool:
    return joint.get("type") != "fixed"
