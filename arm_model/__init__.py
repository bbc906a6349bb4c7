"""What an arm is: kinematics, dynamics, effects; and its simulation, fast."""
