"""An identification and its predictions as tables of pandas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_report.notebook import frame_of, frame_over_time

if TYPE_CHECKING:
    import pandas

    from identification.base_result import BaseIdentification
    from identification.result import Identification, Prediction, Value

What = Literal["parameters", "base_parameters", "joints"]
"""The tables of an identification."""
BaseTable = Literal["parameters", "degrees", "joints"]
"""The tables of the identification of a floating base."""
VALUE = ("value", "std", "unit", "identifiable", "why")
SIDES = {"fit": False, "held_out": True}


def identification_frame(result: Identification, what: What) -> pandas.DataFrame:
    """``parameters`` by name, ``base_parameters`` by expression, or errors of the ``joints`` by number."""
    if what not in get_args(What):
        raise InputError("to_pandas", f"has the tables {', '.join(get_args(What))} (is {what!r})")
    attributes = {"arm": result.arm.name, "method": result.method, "fit": list(result.fit), "held_out": result.held_out}
    if what != "joints":
        values = result.parameters if what == "parameters" else result.base
        return values_frame(values, "name" if what == "parameters" else "expression", attributes)
    rows = []
    for joint in range(len(result.arm)):
        row: dict[str, Any] = {"joint": joint + 1, "unit": result.torque_unit(joint)}
        for side, held_out in SIDES.items():
            row[f"rms_{side}"] = result.rms(held_out, joint)
            row[f"relative_error_{side}"] = result.relative_error(held_out, joint)
        noise = result.noise_of(joint)
        row["noise_ratio"] = None if noise is None else noise.ratio
        rows.append(row)
    columns = [f"{size}_{side}" for size in ("rms", "relative_error") for side in SIDES]
    return frame_of(rows, [*columns, "noise_ratio", "unit"], "joint", attributes)


def base_frame(result: BaseIdentification, what: BaseTable) -> pandas.DataFrame:
    """``parameters`` by name, or errors of the ``degrees`` of freedom by name or of the ``joints`` by number."""
    if what not in get_args(BaseTable):
        raise InputError("to_pandas", f"has the tables {', '.join(get_args(BaseTable))} (is {what!r})")
    attributes = {"arm": result.arm.name, "fit": list(result.fit), "held_out": result.held_out}
    if what == "parameters":
        values = [one.to_json() for one in (*result.parameters, *result.joints.parameters)]
        columns = ("value", "std", "nominal", "unit", "identifiable")
        return frame_of(values, columns, "name", attributes, texts=("unit", "identifiable"))
    table = result.to_json()
    index, drives = ("degree", "thrust_rms") if what == "degrees" else ("joint", "torque_rms")
    rows = [
        {
            index: one[index],
            drives: one[drives],
            "error_fit": one["error_rms"]["fit"],
            "error_before": one["error_rms"]["held_out"]["before"],
            "error_after": one["error_rms"]["held_out"]["after"],
        }
        for one in table[what]
    ]
    return frame_of(rows, (drives, "error_fit", "error_before", "error_after"), index, attributes)


def values_frame(values: Sequence[Value], index: str, attributes: dict[str, Any]) -> pandas.DataFrame:
    """A row per value: value, std (NaN where the data do not determine it), unit, identifiable, and why not."""
    rows = [{index: one.name, **{name: getattr(one, name) for name in VALUE}} for one in values]
    return frame_of(rows, VALUE, index, attributes, texts=("unit", "identifiable", "why"))


def by_row(run: Prediction) -> tuple[Array, dict[str, Array]]:
    """t (k,) s, and measured, predicted, residual (k, joints) N m or N; NaN in rows that its equations leave out."""
    t, row = np.unique(run.t, return_inverse=True)
    values = {}
    for kind in ("measured", "predicted", "residual"):
        values[kind] = np.full((len(t), int(np.max(run.joint, initial=-1)) + 1), np.nan)
        values[kind][row, run.joint] = getattr(run, kind)
    return t, values


def prediction_frame(run: Prediction) -> pandas.DataFrame:
    """By t (s): ``measured1``, ``predicted1``, ``residual1``, .. per joint."""
    t, values = by_row(run)
    columns = {
        f"{kind}{joint + 1}": table[:, joint] for kind, table in values.items() for joint in np.unique(run.joint)
    }
    return frame_over_time(t, columns, {"run": run.run, "held_out": run.held_out})
