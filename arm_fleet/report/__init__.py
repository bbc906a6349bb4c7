"""Pages, text and Parquet tables of a fleet."""
