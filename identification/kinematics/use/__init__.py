"""What a calibration is used for: poses to measure, corrected targets, the ISO cube."""
