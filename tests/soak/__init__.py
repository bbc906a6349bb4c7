"""Soak: a 20 kHz rig for minutes or hours, among subscribers and strangers that misbehave.

With devices, disks and processes that fail.
"""
