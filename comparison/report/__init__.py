"""A comparison as text, plots, a page and files."""
