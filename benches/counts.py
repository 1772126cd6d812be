"""Instructions of the hot paths, counted by callgrind and held against the stored ones: figures without noise.

``python benches/counts.py`` measures and compares, ``--write`` stores what it finds in ``counts.json``. Counts are
those of one compiler and of the machine's vector units up to AVX2, which is all valgrind knows.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STORED = Path(__file__).with_suffix(".json")
TOLERANCE = 0.02
CALLGRIND = (
    "valgrind",
    "--quiet",
    "--tool=callgrind",
    "--demangle=no",
    "--collect-atstart=no",
    "--combine-dumps=yes",
    # Of two options with the same pattern callgrind forgets one.
    "--toggle-collect=*counts*measured*",
    "--dump-after=*6counts8measured*",
)


def output(*command: str, **more: str) -> str:
    """Run a command in the checkout and return what it prints."""
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | more, check=True, stdout=subprocess.PIPE, text=True
    ).stdout


def program(profile: str) -> str:
    """Build the paths and return the program."""
    command = ("cargo", "build", "--quiet", "--bench", "counts", "--profile", profile)
    messages = map(json.loads, output(*command, "--message-format=json").splitlines())
    return next(m["executable"] for m in messages if m.get("executable"))


def counts(run: str, simd: str) -> dict[str, int]:
    """Return the instructions of each path on a vector unit."""
    with tempfile.TemporaryDirectory() as folder:
        dumps = Path(folder, "dumps")
        names = output(*CALLGRIND, f"--callgrind-out-file={dumps}", run, GRANULAR_ID_SIMD=simd).splitlines()
        totals = re.findall(r"^totals: (\d+)$", dumps.read_text(), re.MULTILINE)
    return {f"{name}, {simd}": int(total) for name, total in zip(names, totals[: len(names)], strict=True)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--profile", default="bench", help="dev: the build of the tests, which is there already"
    )
    parser.add_argument("--write", action="store_true", help="store the counts")
    given = parser.parse_args()
    run = program(given.profile)
    found = counts(run, "baseline")
    if "avx2" in Path("/proc/cpuinfo").read_text():
        found |= counts(run, "avx2")
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    compiler = f"{output('rustc', '--version').strip()} for {platform.machine()}"
    if given.write:
        stored[given.profile] = {"compiler": compiler, "instructions": found}
        STORED.write_text(json.dumps(stored, indent=2, sort_keys=True) + "\n")
        return 0
    known = stored.get(given.profile, {"compiler": "no compiler", "instructions": {}})
    if known["compiler"] != compiler:
        print("".join(f"{instructions:>10,} {name}\n" for name, instructions in found.items()))
        print(
            f"not compared: stored are counts with {known['compiler']}, this is {compiler}; --write stores these"
        )
        return 0
    wrong = 0
    for name, instructions in found.items():
        before = known["instructions"].get(name, 0)
        change = instructions / before - 1 if before else float("inf")
        far = abs(change) > TOLERANCE
        wrong += far
        print(f"{instructions:>10,} {change:+8.1%} {'!' if far else ' '} {name}")
    gone = known["instructions"].keys() - found.keys()
    if wrong or gone:
        print(
            f"{wrong} of {len(found)} counts differ by more than {TOLERANCE:.0%} from benches/counts.json, {len(gone)} "
            f"are gone. If that is meant: python3 benches/counts.py --profile {given.profile} --write",
            file=sys.stderr,
        )
    return int(bool(wrong or gone))


if __name__ == "__main__":
    sys.exit(main())
