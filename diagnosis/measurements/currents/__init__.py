"""Effects that show in the motor currents along a measured motion."""
