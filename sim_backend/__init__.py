"""The simulated rig: arm, controller, encoders, transducers and tracker, behind the shapes of the drivers (docs/simulated_rig.md)."""
