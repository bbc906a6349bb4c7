"""Models of encoders, transducers, converters, counter registers and their noise."""
