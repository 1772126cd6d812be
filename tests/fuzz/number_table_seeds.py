"""Write seeds for the fuzzer of CSV text: the good file and the bad ones of the tests, without their header.

    python tests/fuzz/number_table_seeds.py

They go to ``corpus/number_table`` beside this script, where the fuzzer adds what it finds.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python" / "io"))

from test_csv_bad_files import BAD, GOOD, HEADER  # noqa: E402  # only now can it be found

CORPUS = HERE / "corpus" / "number_table"
N_COLUMNS = HEADER.count(b",") + 1
LONGEST = 10_000
"""Bytes of a seed: longer ones than two lines can be slow the fuzzer down."""

CORPUS.mkdir(parents=True, exist_ok=True)
bodies = [GOOD, *(data for data, *_ in BAD.values() if data.startswith(HEADER))]
for i, data in enumerate(bodies):
    body = data.removeprefix(HEADER)[:LONGEST]
    (CORPUS / f"seed_{i:03d}").write_bytes(bytes([N_COLUMNS]) + body)
    (CORPUS / f"seed_{i:03d}_lines").write_bytes(bytes([N_COLUMNS]) + body.replace(b"\n", b"\r\n"))
print(f"{2 * len(bodies)} seeds in corpus/number_table")
