"""Rigid links in space: kinematics, inertia, the Newton-Euler recursion, its regressor, and the water around them."""
