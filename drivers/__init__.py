"""Hardware, one file per device, behind a few small shapes (``drivers.protocols``)."""
