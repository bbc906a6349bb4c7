"""Tasks: definition, limits, storage of results, and execution on Dask."""
