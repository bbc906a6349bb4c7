"""Stored results of two sides, identifications or diagnoses: what they say, and how it differs."""
