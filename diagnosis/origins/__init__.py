"""Physical origins of named causes: what an engineer would suspect, and the check that confirms or refutes it."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.origins.evidence import Evidence, evidence_of
    from diagnosis.origins.ranking import JUDGEMENT, Suspect, suspects
    from diagnosis.origins.table import Origin, Table, read_table
else:
    __getattr__ = lazy(__name__)

__all__ = ["JUDGEMENT", "Evidence", "Origin", "Suspect", "Table", "evidence_of", "read_table", "suspects"]
