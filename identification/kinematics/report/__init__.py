"""Results of a calibration as files and a page."""
