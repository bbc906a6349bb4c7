"""Finds a driver by the import path in the rig file and makes its device.

A driver module offers ``Config`` (a pydantic model of the device's table, without ``name`` and ``driver``) and
``make(name, config, context) -> Device``, which touches no hardware; ``context`` is the rig's ``RigContext``. It may
offer ``find(config) -> list[str]``: the devices of its kind on this machine, which ``doctor`` lists if one does not
answer.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

from pydantic import BaseModel

from arm_io import InputError, check_table
from drivers.protocols import Device
from drivers.rig_context import RigContext


def find_driver(path: str, where: str = "driver") -> ModuleType:
    """The module at an import path such as ``drivers.labjack_t7``; InputError if it is no driver."""
    if not all(part.isidentifier() for part in path.split(".")):
        raise InputError(where, f"driver {path[:80]!r} is not an import path; one like 'drivers.labjack_t7' is needed")
    try:
        module = importlib.import_module(path)
    except ImportError as error:
        own = f"; the folder that holds {path.partition('.')[0]}.py must be in PYTHONPATH"
        hint = own if error.name == path.partition(".")[0] else ""
        raise InputError(where, f"driver {path!r} cannot be imported: {error}{hint}") from None
    except SyntaxError as error:
        raise InputError(where, f"driver {path!r}: {error.filename}, line {error.lineno}: {error.msg}") from None
    if not (hasattr(module, "Config") and callable(getattr(module, "make", None))):
        raise InputError(where, f"{path!r} is not a driver: it has no Config and make()")
    return module


def check_config(path: str, table: dict[str, Any], where: str) -> BaseModel:
    """The device's table checked by its driver's own Config."""
    config: BaseModel = check_table(where, table, find_driver(path, where).Config)
    return config


def find_devices(path: str, table: dict[str, Any], where: str) -> list[str]:
    """Places where such a device was found, if it is not where the rig file says.

    They come from the driver's ``find(config)``; empty for a driver without one.
    """
    module = find_driver(path, where)
    found: list[str] = module.find(check_config(path, table, where)) if hasattr(module, "find") else []
    return found


def make_device(path: str, name: str, table: dict[str, Any], context: RigContext, where: str) -> Device:
    """A closed device, ready to ``open``."""
    device: Device = find_driver(path, where).make(name, check_config(path, table, where), context)
    return device
