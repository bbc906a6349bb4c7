"""MuJoCo models (MJCF): an arm read from one, and given back with only its numbers changed."""

from arm_model.mjcf.gaps import mjcf_gaps
from arm_model.mjcf.reading import SUFFIXES, mjcf_of, read_mjcf
from arm_model.mjcf.update import update_mjcf

__all__ = ["SUFFIXES", "mjcf_gaps", "mjcf_of", "read_mjcf", "update_mjcf"]
