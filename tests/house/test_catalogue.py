"""What is known of an effect stands in its definition (``arm_model.effects``): no measurement names one.

A detector that is an algorithm of its own (a spectral line, a jump, the Denavit-Hartenberg errors of a link) refers to
the definition that it finds, never to a name; which modules these are is listed here, each with its reason.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from arm_model.effects import CATALOGUE, catalogue
from tests.house.sources import syntax

ROOMS = ("diagnosis", "identification")
FAMILIES = {value.__name__ for value in vars(catalogue).values() if isinstance(value, ModuleType)}
"""Modules that hold the definitions."""

NAMES_OF_SOMETHING_ELSE = {
    "diagnosis/distortion/distortion.py": "parameters of an arm (arm_model.parameters): a joint's rotor_inertia and "
    "torque_constant",
    "diagnosis/experiments/motions.py": "the key of a known mass in the [setup] table of an experiment",
    "identification/floating_base/joints.py": "a parameter of an arm: a joint's rotor_inertia",
    "identification/regression/model_parameters.py": "a parameter of an arm: a joint's rotor_inertia",
    "identification/regression/physical_consistency.py": "a parameter of an arm: a joint's rotor_inertia",
    "diagnosis/closed_loop/friction.py": "a parameter of an arm: a joint's rotor_inertia",
}
DETECTORS = {
    "diagnosis/screening/mains_hum.py": "a spectral line at the frequency of the mains",
    "diagnosis/screening/current_limit.py": "currents that pile up at one value",
    "diagnosis/screening/encoder_jumps.py": "jumps of angles between two rows",
    "diagnosis/screening/lost_rows/counter_gaps.py": "an angle that jumps by its turn in rows that its counter lost",
    "diagnosis/screening/lost_rows/losses.py": "a lag that changes by whole rows",
    "diagnosis/screening/lost_rows/missing_rows.py": "rows that all counters lost, by jumps of all moving angles",
    "diagnosis/measurements/demands/wrist_coupling.py": "motor angles that depart from the setpoints of their own axes",
    "diagnosis/measurements/link_encoders/zero_offsets.py": "the constant between two encoders, which is always free",
    "diagnosis/measurements/tracker/candidates.py": "values of the kinematic chain, which are fitted and not added",
    "diagnosis/measurements/tracker/model.py": "geometric errors of a link, which merge and come apart",
    "diagnosis/measurements/tracker/causes.py": "geometric errors that shrink to a zero; points off by far, which "
    "are counted",
    "diagnosis/residual/run_setup.py": "a known mass at the flange, put there by a person",
}


def _named(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of every effect that a module names by a string."""
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Constant) and node.value in CATALOGUE:
            yield node.lineno, str(node.value)


def _definitions(path: Path) -> set[str]:
    """Modules of single definitions that a module imports."""
    imported = {node.module for node in ast.walk(syntax(path)) if isinstance(node, ast.ImportFrom) and node.module}
    return imported & FAMILIES


def _modules(root: Path) -> dict[str, Path]:
    return {str(path.relative_to(root)): path for room in ROOMS for path in sorted((root / room).rglob("*.py"))}


def test_no_module_names_an_effect(root: Path) -> None:
    named = {name: list(_named(path)) for name, path in _modules(root).items()}
    found = [
        f"{name}:{line}: {effect!r}"
        for name, places in named.items()
        if name not in NAMES_OF_SOMETHING_ELSE
        for line, effect in places
    ]
    assert not found, "what is known of an effect belongs into its definition in arm_model/effects:\n" + "\n".join(
        found
    )
    assert all(named[name] for name in NAMES_OF_SOMETHING_ELSE), "an entry of NAMES_OF_SOMETHING_ELSE is needed no more"


def test_only_detectors_of_their_own_refer_to_single_definitions(root: Path) -> None:
    referring = {name for name, path in _modules(root).items() if _definitions(path)}
    assert referring == set(DETECTORS)


def test_a_table_of_effects_is_seen(tmp_path: Path) -> None:
    module = tmp_path / "table.py"
    module.write_text('from arm_model.effects.sensing import MAINS_HUM\nGAINS = {"backlash": 2.0, "other": 1.0}\n')
    assert list(_named(module)) == [(2, "backlash")]
    assert _definitions(module) == {"arm_model.effects.sensing"}
