"""What the simulated devices share: settings, faults, clock, trigger line, latches."""
