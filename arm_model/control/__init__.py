"""Torque controllers: computed torque, momentum observer, the thesis's disturbance decoupling, time scaling.

The independent-joint servos of industrial arms are part of the arm (``arm_model.servo``). docs/underwater.md compares
the controllers.
"""
