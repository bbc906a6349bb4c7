"""A fleet of simulated arms that wear: recordings and true values."""
