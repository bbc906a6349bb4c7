"""Measured and simulated arm under their servos: comparison, and transmission resonances identified there."""
