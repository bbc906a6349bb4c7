"""Kinematic identification from an external tracker.

Models, circle points, least squares, poses, corrected kinematics.
"""
