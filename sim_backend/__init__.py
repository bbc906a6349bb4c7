"""The simulated rig: arm, controller, encoders, transducers and tracker, behind the shapes of the drivers.

See docs/simulated_rig.md.
"""
