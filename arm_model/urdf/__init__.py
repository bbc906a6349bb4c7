"""URDF: an arm read from it and written to it, a file given back with only its numbers changed, what it leaves open."""

from arm_model.urdf.gaps import Use, urdf_gaps
from arm_model.urdf.reading import read_urdf, urdf_of
from arm_model.urdf.update import update_urdf
from arm_model.urdf.writing import not_in_urdf, unknown_in_urdf, write_urdf

__all__ = ["Use", "not_in_urdf", "read_urdf", "unknown_in_urdf", "update_urdf", "urdf_gaps", "urdf_of", "write_urdf"]
