"""What every cause must pass with all others in the model, by the exact equations and in closed loop."""
