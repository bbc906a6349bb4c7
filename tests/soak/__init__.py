"""Soak: a 20 kHz rig for minutes or hours, among subscribers and strangers that misbehave, with devices, disks and processes that fail."""
