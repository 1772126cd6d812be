"""What refusing each file of the corpus of bad files takes: seconds and memory, the worst first.

Run: python benches/bad_files.py [rows]. Every file is loaded alone and then with a good one beside it, in a fork of a
process that has imported all libraries; MB is what the fork's memory grew by at its peak, over both.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "python"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "python" / "io"))

from bad_files import make_corpus
from bad_files_work import answers_to
from test_bad_files import GROUPS


def main() -> None:
    n_rows = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with tempfile.TemporaryDirectory() as folder:
        files = [
            file
            for group, cases in GROUPS.items()
            for file in make_corpus(Path(folder) / group, dict(cases()))
        ]
        answers = answers_to([file.job() for file in files], at_once=1)
    broken = [file.name for file, answer in zip(files, answers, strict=True) if "broken" in answer]
    rows = [
        (answer["alone"]["seconds"], answer["alone"]["cpu_seconds"], answer["megabytes"], file.name)
        for file, answer in zip(files, answers, strict=True)
        if "broken" not in answer
    ]
    refused = sum("error" in answer["alone"] for answer in answers if "broken" not in answer)
    print(f"{len(files)} files, {refused} refused, {len(broken)} hung or died: {', '.join(broken)}")
    for title, column in (("slowest", 1), ("largest", 2)):
        print(f"\n{'s':>7} {'s CPU':>7} {'MB':>5}  the {title}")
        for seconds, cpu_seconds, megabytes, name in sorted(rows, key=lambda row: -row[column])[:n_rows]:
            print(f"{seconds:7.2f} {cpu_seconds:7.2f} {megabytes:5.0f}  {name}")


if __name__ == "__main__":
    main()
