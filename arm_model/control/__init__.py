"""Controllers that know the arm's equations: computed torque, and decoupling from disturbances that it does not know.

The independent-joint servos of industrial arms are part of the arm (``arm_model.servo``).
"""
