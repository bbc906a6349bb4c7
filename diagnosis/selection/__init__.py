"""Selection of causes by held-out gain: regression, significance, aliasing."""
