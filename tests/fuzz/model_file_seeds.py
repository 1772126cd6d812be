"""Write seeds for the fuzzer of model files: good ones and the tests' bad ones, whole and in parts.

    python tests/fuzz/model_file_seeds.py

They go to ``corpus/model_file`` beside this script, where the fuzzer adds what it finds.
"""

import struct
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

from granular_id._core import FeatureSpec  # noqa: E402
from model_bad_files import BAD, GOOD, without_raw  # noqa: E402  # only now can they be found
from model_cases import banded_model, random_model, small_model, with_rules  # noqa: E402

CORPUS = HERE / "corpus" / "model_file"
LONGEST = 4096
PLAIN = FeatureSpec(n_bins=2, order=1, hfmh=False)
BANDED = ((("level",),), (("quantiles", "level"),), (("coupling", "envelope", "spectrum"), 20, 2))

CORPUS.mkdir(parents=True, exist_ok=True)
good = [GOOD, without_raw(7), random_model(1, 2, 1, 1, PLAIN).to_bytes(), small_model(loss="root").to_bytes()]
good += [banded_model(*sizes).to_bytes() for sizes in BANDED]
good.append(random_model(7, 3, 5, 2, FeatureSpec(n_bins=4, order=2), **with_rules(18)).to_bytes())
files = [data for data in (*good, *(data for data, _ in BAD.values())) if len(data) <= LONGEST]
for i, data in enumerate(files):
    (CORPUS / f"seed_{i:03d}").write_bytes(b"\0" + data)
    (length,) = struct.unpack("<Q", data[:8].ljust(8, b"\0"))
    if 0 < length < 1 << 16:
        (CORPUS / f"seed_{i:03d}_parts").write_bytes(b"\1" + struct.pack("<H", length) + data[8:])
print(f"{len(files)} seeds in corpus/model_file")
