"""URDF: an arm read from it and written to it, a file given back with only its numbers changed, what it leaves open."""

from arm_model.urdf.gaps import Use, urdf_gaps
from arm_model.urdf.reading import not_in_urdf, read_urdf, urdf_of, write_urdf
from arm_model.urdf.update import update_urdf

__all__ = ["Use", "not_in_urdf", "read_urdf", "update_urdf", "urdf_gaps", "urdf_of", "write_urdf"]
