"""Expressions as tapes of single operations, and tapes as text: equations, LaTeX, Python, C."""
