"""Kinematic identification from an external tracker: models, circle points, least squares, poses, correction."""
