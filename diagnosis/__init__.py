"""Measured against simulated -> causes -> extended model -> gain; the report."""
