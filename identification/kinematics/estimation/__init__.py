"""Calibration: estimation of kinematic parameters, with cross-validation."""
