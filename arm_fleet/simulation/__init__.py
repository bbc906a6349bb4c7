"""A fleet of simulated arms that wear, with the truth beside their recordings."""
