"""NumPy files: ``.npz`` archives, read and written, and ``.npy`` arrays, read."""
