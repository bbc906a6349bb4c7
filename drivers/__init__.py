"""Hardware, one file a device, behind a few small shapes (``drivers.protocols``)."""
