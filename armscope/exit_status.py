"""How a command ends, as the shell sees it: the same for every command and in all versions."""

DONE = 0
NOBODY_READS = 1
"""Whoever read the output has gone."""
UNUSABLE_INPUT = 2
DEVICE_FAILED = 3
SAMPLES_LOST = 4
"""Done, but samples or results are missing, also in a recording that the command read."""
CHANGED = 5
"""Done, and ``compare`` found a change beyond ``--fail-above``, or ``trend`` a limit as near as ``--fail-within``."""
INTERRUPTED = 130
