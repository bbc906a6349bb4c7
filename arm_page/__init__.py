"""The control room: a page in the browser that shows a rig live, operates it, and opens recordings and results.

It is a separate process and a client of the rig's daemon, so that drawing does not delay the sampler (docs/page.md).
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_page.analyses import Analysis
    from arm_page.server import Page
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Analysis",
    "Page",
]
