"""The simulated arm: its motion and the signals that instruments would be connected to."""
