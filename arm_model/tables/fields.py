"""Types of the entries that the tables of a model file share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, ConfigDict, Field

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Directions = Annotated[tuple[float, float], BeforeValidator(lambda v: (v, v) if isinstance(v, int | float) else v)]
"""(positive, negative): one value for motion in either direction; a single number stands for both."""
Row = tuple[float, float, float, float]
Pose = tuple[Row, Row, Row, Row]
"""4x4 homogeneous transform, row by row; lengths m."""

IDENTITY: Pose = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
