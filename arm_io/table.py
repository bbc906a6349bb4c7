"""The common base of all tables that are read from files: no unknown entries, only finite numbers, immutable."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Seconds = Annotated[float, Field(gt=0, le=1e6)]
"""A waiting time, s: at most 11 days, which every clock and socket can count."""
NoSeconds = Annotated[float, Field(ge=0, le=1e6)]
"""A waiting time, s, that may be 0."""
Rate = Annotated[float, Field(ge=1e-3, le=1e7)]
"""Rows/s."""


class Table(BaseModel):
    """Base of the pydantic models of files. (Not imported by ``arm_io`` itself: pydantic takes its time.)."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
