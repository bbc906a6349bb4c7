"""JSON arguments from untrusted clients.

The size is limited before anything is expanded, numbers must be finite, and every violation is one typed error.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

from arm_io import InputError

MOST_STRUCTURE = 1 << 16
"""Bytes outside strings.

They bound the nesting and the number of entries; the text of an experiment is inside a string.
"""
MOST_DIGITS = 19
"""Of an integer: what fits into 64 bits."""
# Possessive, and the closing quote optional: one pass over the text, whatever it holds.
_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)


def parse(payload: bytes, where: str) -> dict[str, Any]:
    """The JSON object in ``payload``; {} for an empty payload. InputError at ``where`` for anything else.

    Numbers must be finite; integers may have at most 19 digits.
    """
    if not payload:
        return {}
    if len(_STRING.sub(b"", payload)) > MOST_STRUCTURE:
        raise InputError(where, f"arguments hold more than {MOST_STRUCTURE} bytes outside strings")
    try:
        table = json.loads(
            payload.decode("utf-8"), parse_constant=_no_constant, parse_float=_finite, parse_int=_integer
        )
    except RecursionError:
        raise InputError(where, "arguments are nested too deeply") from None
    except ValueError as error:
        raise InputError(where, f"arguments are not JSON: {error}") from None
    if not isinstance(table, dict):
        raise InputError(where, "arguments must be a JSON object")
    return table


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number that JSON knows")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:30]} is too large")
    return value


def _integer(text: str) -> int:
    if len(text.lstrip("-")) > MOST_DIGITS:
        raise ValueError(f"an integer of {len(text)} digits; at most {MOST_DIGITS}")
    return int(text)
