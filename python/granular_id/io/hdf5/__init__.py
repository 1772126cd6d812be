"""HDF5 files, read within bounds and written."""
