"""Results of an identification as files, plots and a page."""
