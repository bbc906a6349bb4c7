"""What a task is, its limits, where its result is kept, and how Dask runs it."""
