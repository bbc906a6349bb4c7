"""The rig: its file, its channels and calibration, its open devices, and the guard in front of everything that moves."""
