"""Arms that nobody here made: random ones, each through every command."""
