"""Kinematic chains and their parameterisations."""
