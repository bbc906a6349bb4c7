"""One parameter let vary in time (model distortion): estimation, dependence on other variables, report."""
