"""Arms from elsewhere: random ones through every command, and twelve in MuJoCo in which effects are hidden."""
