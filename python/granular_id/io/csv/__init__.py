"""CSV files: a recording each, read and written; and the rows of GM10-ts."""
