"""An arm with its drives, transmissions, effects and servos as one system of equations, and its inverse."""
