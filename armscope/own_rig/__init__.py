"""A starter project for an arm that a user brings: a simulated rig, drives where its file has none, a first motion."""

from armscope.own_rig.project import OwnRig, own_project

__all__ = ["OwnRig", "own_project"]
