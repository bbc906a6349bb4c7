"""Recordings -> parameters: dynamics, friction, kinematics, experiment design."""
