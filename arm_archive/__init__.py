"""The archive of a laboratory: an index of the recordings and results in a folder, stored in the same folder.

All information comes from the files. The index (``FOLDER/armscope-archive.sqlite``) can be deleted at any time, and is
then made again.
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_archive.archive import Archive, open_archive
    from arm_archive.entries import COLUMNS, Entry
    from arm_archive.filters import Filters
    from arm_archive.history_plot import history_figure
    from arm_archive.index import INDEX
else:
    __getattr__ = lazy(__name__)

__all__ = ["COLUMNS", "INDEX", "Archive", "Entry", "Filters", "history_figure", "open_archive"]
