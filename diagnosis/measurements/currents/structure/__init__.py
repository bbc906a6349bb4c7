"""Structure in residual currents that no effect of the catalogue explains: functions of one variable."""
