"""Arms from elsewhere: random ones through every command, and six in MuJoCo in which effects are hidden."""
