"""What people hand us, and how it is refused: one line that says where, what, and what would be right."""

from arm_io.errors import DeviceFault, InputError, counted
from arm_io.files import read_file, read_text
from arm_io.lazy import lazy
from arm_io.results import check_file, check_folder, make_folder, whole_file, whole_path, write_text
from arm_io.toml import check_table, read_toml, toml_of, write_toml

__all__ = [
    "DeviceFault",
    "InputError",
    "check_file",
    "check_folder",
    "check_table",
    "counted",
    "lazy",
    "make_folder",
    "read_file",
    "read_text",
    "read_toml",
    "toml_of",
    "whole_file",
    "whole_path",
    "write_text",
    "write_toml",
]
