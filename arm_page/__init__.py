"""The control room: a page in the browser that shows a rig live, steers it, and opens what was recorded.

A process of its own and a client of the rig's daemon: drawing costs the sampler nothing (docs/page.md).
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
