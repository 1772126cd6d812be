"""Parquet: archives of recordings, read and written, and tables of others, read."""
