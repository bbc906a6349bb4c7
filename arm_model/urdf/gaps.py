"""What a URDF file leaves open, and what stands in for it: missing meshes, links without inertia, gears as words."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from collections.abc import Collection, Sequence
from enum import StrEnum
from pathlib import Path

from arm_io import read_file
from arm_io.plain_data import is_number
from arm_model.branches import are, counted_as_fixed, follows, listed
from arm_model.meshes import FORMATS, mesh_file
from arm_model.urdf.reading import numbers_of, reductions
from arm_model.urdf.tree import Tree, link_at, robot_of


class Use(StrEnum):
    """What a file is read for."""

    DYNAMICS = "dynamics"
    COLLISIONS = "collisions"
    PICTURE = "picture"


def urdf_gaps(path: str | Path, uses: Collection[Use], *, tip: str | None = None) -> list[str]:
    """One sentence for each kind of thing that a URDF file does not say and ``uses`` need; empty for other files.

    InputError as ``read_urdf``, which must have read the file before.
    """
    path = Path(path)
    if path.suffix != ".urdf":
        return []
    gaps = _beside(path, tip) + _mimics(path, tip) + _gears(path) if Use.DYNAMICS in uses else []
    if Use.DYNAMICS in uses and (massless := _massless(path, tip)):
        gaps.append(
            f"{_names('link', massless)} no <inertial>: mass and inertia count as 0 until the file or "
            "'armscope identify' says them"
        )
    for use, tag, instead in (
        (Use.COLLISIONS, "collision", "checks of collisions take a capsule from joint to joint for these links"),
        (Use.PICTURE, "visual", "these links are drawn as capsules or lines from joint to joint"),
    ):
        if use in uses and (missing := missing_meshes(path, tag)):
            gaps.append(f"{listed(missing)} of <{tag}> {are(missing)} not there or not {_formats()}: {instead}")
    return gaps


def missing_meshes(path: str | Path, tag: str) -> list[str]:
    """Names of mesh files of <collision> or <visual> (``tag``) that are not there, as a URDF file names them."""
    robot = robot_of(path, read_file(path))
    named = [mesh.get("filename", "") for mesh in robot.iterfind(f"link/{tag}/geometry/mesh")]
    return [name for name in dict.fromkeys(named) if mesh_file(Path(path), name) is None]


def _massless(path: Path, tip: str | None) -> list[str]:
    """Names of moving links of which no <inertial> speaks: neither their own nor one of what is fixed to them."""
    tree = Tree.of(path, robot_of(path, read_file(path)))
    stated: dict[str, bool] = {}
    moving = ""
    chain = tree.chain(tip)
    for joint in chain:
        child = link_at(path, joint, "child")
        moving = moving if joint.get("type") == "fixed" else child
        stated[moving] = stated.get(moving, False) or _has_inertial(tree, child, chain)
    return [name for name, there in stated.items() if name and not there]


def _has_inertial(tree: Tree, link: str, chain: Sequence[xml.Element]) -> bool:
    """Whether a link or something that is fixed to it beside the chain has an <inertial>."""
    below = (link_at(tree.path, one, "child") for one in tree.beside(link, chain))
    return tree.links[link].find("inertial") is not None or any(_has_inertial(tree, one, chain) for one in below)


def _beside(path: Path, tip: str | None) -> list[str]:
    """What the chain to the tip passes by: other links at its end, and branches that move."""
    tree = Tree.of(path, robot_of(path, read_file(path)))
    chain = tree.chain(tip)
    found = []
    if tip is None and (others := [name for name in tree.ends(chain) if name != tree.names(chain)[-1]]):
        found.append(f"the tool frame is {tree.names(chain)[-1]}; --tip takes {listed(others)} instead")
    for counted in (True, False):
        moving = [one for one in tree.moving_beside(chain) if tree.moves(link_at(path, one, "parent")) == counted]
        if not moving:
            continue
        names, end = [joint.get("name", "") for joint in moving], tree.names(chain)[-1]
        mass = sum(
            numbers_of(path, tree.links[name].find("inertial/mass"), "value", "0", 1)[0]
            for joint in moving
            for name in tree.behind(joint)
        )
        if counted:
            found.append(counted_as_fixed(names, end, mass))
        else:
            found.append(f"{listed(names)} {are(names)} beside the arm on its base: left out")
    return found


def _mimics(path: Path, tip: str | None) -> list[str]:
    """One sentence per joint of the chain that follows another one: here every joint of an arm moves for itself."""
    chain = Tree.of(path, robot_of(path, read_file(path))).chain(tip)
    return [
        follows(joint.get("name", ""), mimic.get("joint", ""), "mimic")
        for joint in chain
        if joint.get("type") != "fixed" and (mimic := joint.find("mimic")) is not None
    ]


def _gears(path: Path) -> list[str]:
    """At most one sentence: of joints whose gear is a word, as a macro leaves one that it did not replace."""
    words = {joint: text for joint, text in reductions(robot_of(path, read_file(path))).items() if not is_number(text)}
    words_listed = listed(list(dict.fromkeys(repr(text) for text in words.values())))
    return (
        [f"mechanicalReduction of {listed(list(words))} is {words_listed}, no number: the gear counts as 1"]
        if words
        else []
    )


def _names(what: str, names: Sequence[str]) -> str:
    return f"{what}{'s' * (len(names) > 1)} {listed(names)} {'have' if len(names) > 1 else 'has'}"


def _formats() -> str:
    return ", ".join(suffix.removeprefix(".").upper() for suffix in FORMATS)
