"""Features have the bits of every other machine: the tests and the checks of wheels run it.

After a change of bits that is meant, EXPECTED is what it prints.
"""

import hashlib

import numpy as np

import granular_id as gid
from granular_id._core import MultiBandExtractor

EXPECTED = "81a2daad6f57c08de63bbe6658b1b8bec9d74bd465cf9d5437cf3caee14144b4"

# Uniform numbers are made of integers: unlike sines and logarithms they are the same on every machine.
X = 4 * np.random.Generator(np.random.PCG64(1)).random((8, 1600, 6)) - 2
features = [X, gid.extract_features(X), MultiBandExtractor(*X.shape[1:]).extract(X)]
digest = hashlib.sha256(b"".join(block.tobytes() for block in features)).hexdigest()
if digest != EXPECTED:
    raise SystemExit(f"sha256 of features is {digest}, not {EXPECTED}")
print(f"sha256 of features: {digest}")
