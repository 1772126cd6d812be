"""Wheels for Linux and the source distribution: built into dist/, audited, installed and run; prints a table.

`make nightly CHECK=wheels` runs it. The wheels are built from the unpacked source distribution, linked by zig, and run
under every python3.X on PATH; --audit only audits what dist/ holds. Other Pythons are commands, such as one of another
processor; --built keeps what dist/ holds:

    .venv/bin/python tests/wheels.py --built \\
        --python "qemu-aarch64 -cpu cortex-a72 -L ROOT ROOT/usr/bin/python3.14"

(Under qemu 7.2 with SVE, its default, OpenBLAS makes wrong models of right features.)

Debian's compiler builds them, too: rustc, cargo, libstd-rust-dev of both processors. For musl cargo makes *.rlib of
rust-src (RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Cembed-bitcode=yes, -Zbuild-std=std), to be copied to
`rustc --print target-libdir`.
"""

import argparse
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DIST, WORK, TOOLS = ROOT / "dist", ROOT / "target" / "publish-work", Path(sys.executable).parent
LIMIT_BYTES = 3_000_000
# abi3 is for every Python from 3.10 that has a GIL. Free-threaded ones have no stable ABI before 3.15.
TARGETS = {
    "x86_64-unknown-linux-gnu": ("manylinux2014", ["python3.10", "python3.14t"]),
    "aarch64-unknown-linux-gnu": ("manylinux2014", ["python3.10", "python3.14t"]),
    "x86_64-unknown-linux-musl": ("musllinux_1_2", ["python3.10"]),
    "aarch64-unknown-linux-musl": ("musllinux_1_2", ["python3.10"]),
}
PROBE = """
import json, platform, sys, sysconfig
of = sysconfig.get_config_var
print(json.dumps([platform.python_version(), platform.machine(), of("SOABI"), bool(of("Py_GIL_DISABLED"))]))
"""


def output(*command, **options) -> str:
    """What a command prints; ends the script where it fails."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    done = subprocess.run(list(map(str, command)), check=False, **pipes, **options)
    if done.returncode:
        raise SystemExit(f"{shlex.join(map(str, command))}\n{done.stdout}")
    return done.stdout


def build() -> list[str]:
    """Build into dist/; returns the Rust targets that are missing."""
    shutil.rmtree(DIST, ignore_errors=True)
    shutil.rmtree(WORK, ignore_errors=True)
    output(TOOLS / "maturin", "sdist", "--out", DIST, cwd=ROOT)
    shutil.unpack_archive(next(DIST.glob("*.tar.gz")), WORK / "source", filter="data")
    (source,) = (WORK / "source").iterdir()
    # Compiled anew each time: files of the archive are all of one old date, by which cargo would take them for known.
    # Not --locked: the archive lacks the benchmarks, whose crates cargo takes out of its lock file.
    environment = {**os.environ, "PATH": f"{TOOLS}{os.pathsep}{os.environ['PATH']}"}
    environment.pop("CARGO_TARGET_DIR", None)
    missing = []
    for target, (tag, pythons) in TARGETS.items():
        if not Path(output("rustc", "--print", "target-libdir", "--target", target).strip()).is_dir():
            missing.append(target)
            continue
        print(f"building for {target} (minutes)", flush=True)
        options = ["--release", "--zig", "--target", target, "--compatibility", tag, "--out", DIST]
        options += [option for python in pythons for option in ("--interpreter", python)]
        output(TOOLS / "maturin", "build", *options, cwd=source, env=environment)
    return missing


def audit(wheel: Path) -> str:
    """Which audits a wheel passed; the first that it fails ends the script."""
    if wheel.stat().st_size > LIMIT_BYTES:
        raise SystemExit(f"{wheel.name} has {wheel.stat().st_size} bytes, more than {LIMIT_BYTES}")
    passed = []
    if "-manylinux" in wheel.name:  # auditwheel knows musl's library by Alpine's name only
        passed, tag = ["auditwheel"], wheel.stem.rpartition(".")[2]
        report = " ".join(output(TOOLS / "auditwheel", "show", wheel).split())
        if f'following platform tag: "{tag}"' not in report:
            raise SystemExit(f"{wheel.name} is not what its name says:\n{report}")
    if "-abi3-" in wheel.name:
        output(TOOLS / "abi3audit", "--strict", wheel)
        passed.append("abi3audit")
    return ", ".join(passed)


def run(command: list[str]) -> tuple[str, str] | None:
    """Install the wheel for a Python and use it; returns the wheel's name and Python's version."""
    probe = subprocess.run([*command, "-c", PROBE], capture_output=True, check=False)
    if probe.returncode:  # a name on PATH without a Python behind it
        return None
    version, machine, extension, free_threaded = json.loads(probe.stdout)
    python = "cp" + "".join(version.split(".")[:2])
    abi = f"{python}-{python}t" if free_threaded else "cp310-abi3"
    family = "musllinux" if extension.endswith("musl") else "manylinux"
    if not (wheel := next(DIST.glob(f"*-{abi}-*{family}*_{machine}.whl"), None)):
        return None
    print(f"running {wheel.name} under {version}", flush=True)
    place = WORK / f"{abi}-{family}-{machine}-{version}"
    shutil.rmtree(place, ignore_errors=True)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if len(command) == 1:
        output(*command, "-m", "venv", place)
        command, cli = [str(place / "bin/python")], [str(place / "bin/granular-id")]
        output(*command, "-m", "pip", "install", f"{wheel}[app]")
    else:  # a chroot may have no pip; this one would ask for what its own Python requires
        options = ["--python-version", version, "--abi", abi.split("-")[1], "--abi", python, "--abi", "none"]
        for libc in ("manylinux2014", *(f"manylinux_2_{glibc}" for glibc in range(17, 40))):
            options += ["--platform", f"{libc}_{machine}"]
        options += ["--ignore-requires-python", "--only-binary", ":all:", "--target", place, f"{wheel}[app]"]
        output(sys.executable, "-m", "pip", "install", *options)
        environment["PYTHONPATH"] = str(place)
        cli = [*command, "-m", "granular_id"]
    here = {"cwd": place, "env": environment}
    output(*command, ROOT / "examples/first_lines.py", **here)
    output(*cli, "--version", **here)
    output(*cli, "demo", "--output", place / "demo", **here)
    output(*command, ROOT / "tests/wheel_digest.py", **here)
    return wheel.name, version


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--built", action="store_true", help="keep what dist/ holds")
    parser.add_argument("--audit", action="store_true", help="audit what dist/ holds, and nothing else")
    parser.add_argument("--python", action="append", default=[], help="a command that starts one more Python")
    chosen = parser.parse_args()
    missing = [] if chosen.built or chosen.audit else build()
    output(TOOLS / "twine", "check", "--strict", *DIST.glob("granular_id-*"))
    audits = {wheel: audit(wheel) for wheel in sorted(DIST.glob("*.whl"))}
    if chosen.audit:
        print("".join(f"{wheel.name}: {passed or 'size'}\n" for wheel, passed in audits.items()), end="")
        return
    names = [f"python3.{minor}{threads}" for minor in range(10, 30) for threads in ("", "t")]
    commands = [*([path] for name in names if (path := shutil.which(name))), *map(shlex.split, chosen.python)]
    runs = [done for command in commands if (done := run(command))]
    print("\n| platform | Python | MB | audit | run |\n|---|---|---:|---|---|")
    for wheel, passed in audits.items():
        _, _, python, abi, tags = wheel.stem.split("-")
        versions = ", ".join(version for name, version in runs if name == wheel.name) or "not run"
        row = f"{tags.rpartition('.')[2]} | {python}-{abi} | {wheel.stat().st_size / 1e6:.2f}"
        print(f"| {row} | {passed} | {versions} |")
    if missing:
        sys.exit(f"not built: rustup target add {' '.join(missing)}")
    ours = f"*-manylinux*_{platform.machine()}.whl"
    not_run = {wheel.name for wheel in DIST.glob(ours)} - {name for name, _ in runs}
    if not runs or (not_run and os.environ.get("CI")):  # hosted, each has its Python
        sys.exit(f"no Python on PATH ran {', '.join(sorted(not_run))}")


if __name__ == "__main__":
    main()
