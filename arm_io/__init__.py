"""What people hand us, and how it is refused: one line that says where, what, and what would be right."""

from arm_io.errors import DeviceFault, InputError
from arm_io.results import check_folder, make_folder, whole_file, write_text
from arm_io.toml import check_table, read_toml, write_toml

__all__ = [
    "DeviceFault",
    "InputError",
    "check_folder",
    "check_table",
    "make_folder",
    "read_toml",
    "whole_file",
    "write_text",
    "write_toml",
]
