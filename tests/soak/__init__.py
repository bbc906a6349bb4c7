"""Soak: a 20 kHz rig for minutes or hours, among misbehaving clients and failing devices, disks and processes."""
