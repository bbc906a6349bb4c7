"""Experiments that discriminate between rival causes or make an effect detectable."""
