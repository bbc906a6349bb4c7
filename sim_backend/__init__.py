"""The arm, its controller, encoders, transducers and tracker, as drivers."""
