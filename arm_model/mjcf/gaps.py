"""What a MuJoCo model has beside the arm that is read from it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from arm_model.branches import are, counted_as_fixed, follows, listed
from arm_model.mjcf.reading import Reading, read_reading
from arm_model.mjcf.tree import Attributes, Node, Tree

_READ_ALL_THE_SAME = {
    "constraint": "frictionloss and ranges",
    "passive": "damping",
    "damper": "damping",
    "frictionloss": "frictionloss",
    "limit": "ranges",
}
"""What a <flag> may disable -> what of the joints is read although it does."""


def mjcf_gaps(path: str | Path, *, tip: str | None = None) -> list[str]:
    """A sentence on the joints beside the chain to ``tip`` that count as fixed, and on what acts on the arm unread.

    That is: gravity compensation, equality constraints, and what the flags of the file disable.

    InputError as ``read_mjcf``, which must have read the file before.
    """
    reading = read_reading(path, tip=tip)
    gaps = []
    hung = [one for one in reading.bodies if one.moves]
    if names := [joint.name for one in hung for joint in one.node.all("joint")]:
        gaps.append(counted_as_fixed(names, reading.end, sum(float(one.parameters[0]) for one in hung)))
    return [*gaps, *_lifted(reading), *_constraints(reading), *_disabled(reading.tree)]


def _lifted(reading: Reading) -> Iterator[str]:
    """At most one sentence: of bodies whose weight the file takes from the motors."""
    tree = reading.tree
    bodies = [one.node for one in reading.bodies]
    names = [body.name for body in bodies if tree.numbers(body.element.attributes, "gravcomp", "0", 1)[0] != 0.0]
    if names and "gravity" not in tree.disabled:
        yield f"gravcomp of {listed(names)} is not read: here the motors carry the whole weight"


def _constraints(reading: Reading) -> Iterator[str]:
    """A sentence per constraint that acts from the beginning between parts of the arm, or the arm and something else.

    One between bodies of one link changes nothing: what moves on a link counts as fixed to it.
    """
    tree = reading.tree
    if tree.disabled & {"equality", "constraint"}:
        return
    joints = {node.name for node, _ in reading.joints}
    links = {one.node.name: one.link for one in reading.bodies}
    sites = {site.name: one.link for one in reading.bodies for site in one.node.all("site")}
    for node in tree.all("equality"):
        given = _given(tree, node)
        if given.get("active", "true") == "false":
            continue
        first, second = given.get("joint1"), given.get("joint2")
        if node.tag == "joint" and first in joints and second:
            yield follows(first, second, "equality")
        elif node.tag == "joint" and joints & {first, second}:
            yield f"{first} is held in its place by <equality>, or moves another joint: read as a joint that is free"
        elif node.tag in ("connect", "weld"):
            ends = [given[name] for name in ("body1", "body2", "site1", "site2") if name in given]
            known = sites if "site1" in given else links
            held = {known.get(name) for name in ends} | (set() if len(ends) == 2 else {None})
            if len(held) == 2:
                yield f"<{node.tag}> holds {' to '.join(ends)}: not read; the chain moves here as if it were not there"
        elif node.tag == "tendon":
            yield "a tendon is constrained by <equality>: not read; the joints move here as if it were not"


def _given(tree: Tree, node: Node) -> Attributes:
    """Attributes of a constraint with those of its default class, which has one set for constraints of all kinds."""
    attributes = node.element.attributes
    return {**tree.defaults.get(attributes.get("class", "main"), {}).get("equality", {}), **attributes}


def _disabled(tree: Tree) -> Iterator[str]:
    """At most one sentence: of what the joints have in the file and its flags disable."""
    if names := [name for name in _READ_ALL_THE_SAME if name in tree.disabled]:
        read = listed(sorted({_READ_ALL_THE_SAME[name] for name in names}))
        yield f"{listed(names)} {are(names)} disabled by <flag>: {read} of the joints are read all the same"
