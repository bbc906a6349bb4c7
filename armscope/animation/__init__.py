"""A recorded or planned motion as a film: GIF, MP4, or a page that needs no network."""

from armscope.animation.scene import (
    MEASURED,
    OTHER,
    Movement,
    animate,
    chain_in,
    check_animation,
    instants,
    movements,
    sticks,
)

__all__ = [
    "MEASURED",
    "OTHER",
    "Movement",
    "animate",
    "chain_in",
    "check_animation",
    "instants",
    "movements",
    "sticks",
]
