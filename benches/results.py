"""Runs the benchmarks and stores their figures, machine, commit and versions in results.json: `make benchmarks`."""

from __future__ import annotations

import datetime
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any

import granular_id as gid
from granular_id._files import write_json

ROOT = Path(__file__).resolve().parents[1]
WRITTEN = ("benches/results.json", "benches/accuracy.json", "docs/benchmarks.md", "README.md")
"""By the benchmarks themselves: a checkout with nothing else changed is that of its commit."""

PACKAGES = ("numpy", "scipy", "numba", "scikit-learn")
UNITS = ("baseline", "avx2", "avx512")
RUNS = 3
QUIET = 0.5  # load per core at most
MINUTES = 10  # of waiting for it, at most
EXTRACTION = "import numpy, granular_id; granular_id.extract_features(numpy.zeros((9, 6)))"


def about(packages: Sequence[str]) -> dict[str, Any]:
    """Describe machine, commit and versions; None stands for what is not installed or not known."""
    others = (f":!{name}" for name in WRITTEN)
    changed = _output("git", "status", "--porcelain", "--untracked-files=no", "--", ".", *others)
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
        "processor": _processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
        "load before": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "real-time priority": hasattr(os, "SCHED_FIFO") and os.sched_getscheduler(0) == os.SCHED_FIFO,
        "commit": _output("git", "rev-parse", "--short=10", "HEAD"),
        "commit is clean": changed == "",
        "compiler": (_output("rustc", "--version") or "").partition(" (")[0],
        "versions": {
            "granular-id": gid.__version__,
            "Python": platform.python_version(),
            **{name: _version(name) for name in packages},
        },
    }


def _processor() -> str:
    """The model; Linux says which generation it is of by numbers only."""
    try:
        known = dict(re.findall(r"^([\w ]+?)\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE))
        return f"{known['model name']} (family {known['cpu family']}, model {known['model']})"
    except (OSError, KeyError):
        return platform.processor() or "unknown"


def _output(*command: str) -> str | None:
    try:
        ran = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return ran.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def measure() -> dict[str, Any]:
    """Run the scripts one after the other; that of the features for each vector unit, several times in turn."""
    wait_for_quiet()
    results: dict[str, Any] = {"made": about(PACKAGES), "runs": RUNS, "features": {}}
    runs: dict[str, list[dict[str, float]]] = {unit: [] for unit in UNITS if has(unit)}
    for _ in range(RUNS):
        for unit, made in runs.items():
            made.append(figures("peers", os.environ | {"GRANULAR_ID_SIMD": unit}))
    for unit, made in runs.items():
        results["features"][unit] = {name: median(run[name] for run in made) for name in made[0]}
    # Rivals are faster with BLAS on one thread, and at real-time priority its threads wait for each other.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    return results | {name: figures(name, environment) for name in ("decision", "ecoc")}


def wait_for_quiet() -> None:
    """Wait until the machine has little else to do, such as after a build."""
    limit = QUIET * (os.cpu_count() or 1)
    for left in range(6 * MINUTES, 0, -1):
        if not hasattr(os, "getloadavg") or os.getloadavg()[0] <= limit:
            return
        print(
            f"load {os.getloadavg()[0]:.1f}: waiting until it is {limit:.1f}, at most {left / 6:.0f} minutes"
        )
        time.sleep(10)
    sys.exit(
        f"The machine is busy: load {os.getloadavg()[0]:.1f}, {limit:.1f} at most for times that can be compared."
    )


def has(unit: str) -> bool:
    """Whether this machine has a vector unit."""
    environment = os.environ | {"GRANULAR_ID_SIMD": unit}
    tried = subprocess.run(
        [sys.executable, "-c", EXTRACTION], check=False, env=environment, capture_output=True
    )
    return tried.returncode == 0


def figures(script: str, environment: Mapping[str, str]) -> dict[str, Any]:
    """Run a script and return what it hands over."""
    print(f"\n{script}.py, GRANULAR_ID_SIMD={environment.get('GRANULAR_ID_SIMD', '')}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "figures.json")
        command = [sys.executable, str(ROOT / f"benches/{script}.py"), "--out", str(out)]
        subprocess.run(command, env=environment, check=True)
        return json.loads(out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    write_json(ROOT / "benches/results.json", measure())
