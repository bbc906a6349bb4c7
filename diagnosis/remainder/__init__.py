"""What is left above the noise with all causes in the model, and what an identified model left from the start."""
