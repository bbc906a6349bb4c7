"""From device blocks to joined, accounted rows: readers, trigger index, join, clocks, ledger."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.acquisition.clock_fit import fit_clock
    from daq.acquisition.ledger import SENTENCES
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "SENTENCES",
    "fit_clock",
]
