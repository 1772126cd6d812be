"""Features of an installed wheel have the bits of every other machine: `make wheels` and the hosted checks run it."""

import hashlib

import numpy as np

import granular_id as gid

EXPECTED = "43f1e6d5c0be485cb816e6ac139b037eb43ccd27a745e6a6ac2f8c92c2c88f02"

# Uniform numbers are made of integers: unlike sines and logarithms they are the same on every machine.
X = 4 * np.random.Generator(np.random.PCG64(1)).random((8, 1600, 6)) - 2
features = [X, gid.extract_features(X), gid.MultiBand().fit_transform(X)]
digest = hashlib.sha256(b"".join(block.tobytes() for block in features)).hexdigest()
if digest != EXPECTED:
    raise SystemExit(f"sha256 of features is {digest}, not {EXPECTED}")
print(f"sha256 of features: {digest}")
