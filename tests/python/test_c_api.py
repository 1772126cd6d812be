"""The C and C++ interfaces: compiled by the system's compiler, with the answers of the package bit for bit."""

import json
import math
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid
from pages import blocks_of

ROOT = Path(__file__).parents[2]
KNOWN = ("fine_sugar", "oat_flakes", "rice", "wheat_flour")
OF_PUSHES = {"duration_s": 0.5, "rate_hz": 500.0}
ONE_MODEL = pytest.mark.parametrize("model", ["raw+hfmh"], indirect=True)
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-pedantic")

pytestmark = [
    pytest.mark.thread_unsafe(reason="starts processes"),
    pytest.mark.skipif(sys.platform == "win32", reason="the programs are compiled by cc and c++"),
]


def run(*command, **options):
    """Run a program, which must succeed, and return what it printed."""
    words = [str(word) for word in command]
    done = subprocess.run(words, check=False, capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout


def needs(program):
    if shutil.which(program) is None:
        pytest.skip(f"no {program} on this machine")


@pytest.fixture(scope="session")
def prefix(tmp_path_factory):
    """Where the library is installed, as cargo builds it for the other tests."""
    for program in ("cargo", "cc", "c++"):
        needs(program)
    # With the features of the core that the other tests build, which are then built once.
    packages = ("--package", "granular-id", "--package", "granular-id-c")
    words = ("cargo", "build", "--quiet", *packages, "--message-format=json")
    made = [json.loads(line) for line in run(*words, cwd=ROOT).splitlines()]
    files = next(line["filenames"] for line in made if line.get("target", {}).get("name") == "granular_id_c")
    folder = tmp_path_factory.mktemp("prefix")
    run(ROOT / "rust" / "c" / "install.sh", folder, Path(files[0]).parent)
    return folder


@pytest.fixture(scope="session")
def compiled(prefix, tmp_path_factory):
    folder = tmp_path_factory.mktemp("programs")

    def compiled(source, *options):
        command = (
            ("c++", "-std=c++17")
            if source.endswith("pp")
            else ("cc", "-std=c99", "-D_POSIX_C_SOURCE=200809L")
        )
        program = folder / f"{source.replace('/', '_')}{len(options)}"
        if not program.exists():
            libraries = (f"-L{prefix / 'lib'}", "-lgranular_id_c", f"-Wl,-rpath,{prefix / 'lib'}", "-pthread")
            includes = (f"-I{prefix / 'include'}", "-o", program)
            run(*command, *WARNINGS, *options, ROOT / source, *includes, *libraries)
        return program

    return compiled


@pytest.fixture(scope="session")
def pushes():
    """100 recordings: of four known materials, and of one that the models do not know."""
    return gid.synthesize([*KNOWN, "potting_gravel"], 20, seed=2, **OF_PUSHES)


@pytest.fixture(scope="session", params=["raw+hfmh", "multiband"])
def model(request):
    data = gid.synthesize(KNOWN, 8, sessions=4, seed=1, **OF_PUSHES)
    return gid.Identifier.fit(data, request.param, coverage=0.99, share_known=0.9)


@pytest.fixture
def model_file(model, tmp_path):
    model.save(tmp_path / "model.safetensors")
    return tmp_path / "model.safetensors"


def line_of(model, decision):
    """What the programs print of a decision, but for the probability."""
    losses = dict(decision.ranking)
    candidates = "".join("01"[label in decision.candidates] for label in model.classes)
    values = (losses[decision.label], decision.margin, *(losses[label] for label in model.classes))
    bits = " ".join(struct.pack(">d", value).hex() for value in values)
    return f"{decision.label} {int(decision.unknown)} {candidates} {bits}"


@pytest.mark.parametrize("source", ["tests/c/answers.c", "tests/c/answers.cpp"])
def test_answers_of_programs_have_the_bits_of_python(source, compiled, model, model_file, pushes, tmp_path):
    pushes.X.astype("<f8").tofile(tmp_path / "pushes")
    printed = run(compiled(source), model_file, tmp_path / "pushes").splitlines()
    decisions = [model.identify(push) for push in pushes.X]
    lines, probabilities = zip(*(line.rsplit(" ", 1) for line in printed), strict=True)
    assert list(lines) == [line_of(model, decision) for decision in decisions]
    wanted = [decision.probability for decision in decisions]
    np.testing.assert_allclose(np.array(probabilities, float), wanted, rtol=1e-13)
    assert len(lines) == 100
    assert {decision.unknown for decision in decisions} == {True, False}
    assert len({decision.candidates for decision in decisions}) > len(KNOWN)


@ONE_MODEL
def test_example_in_c_names_a_recording_of_a_csv_file(compiled, model, model_file, pushes):
    program = compiled("examples/c/identify.c")
    axes, push = pushes.axes, pushes.X[0]
    rows = [",".join((f"{k / 500:.3f}", *map(repr, row[::-1].tolist()))) for k, row in enumerate(push)]
    text = "\n".join([",".join(("time", *axes[::-1])), *rows])
    marked, line = run(program, model_file, input=text).splitlines()
    decision = model.identify(push)
    assert marked.startswith("SYNTHETIC")
    assert (
        f"{decision.label}, margin {decision.margin:.4f}, probability {decision.probability:.3f}; may be"
        in line
    )
    for broken in (
        "",
        text.replace("fx", "gx"),
        text.replace("tz", "tx"),
        text[: len(text) // 2],
        f"{text}\n{rows[0]}",
        "\n".join([text, "1,x"]),
    ):
        done = subprocess.run(
            [program, model_file], check=False, capture_output=True, text=True, input=broken
        )
        assert (done.returncode, done.stderr[:10]) == (1, "identify: ")


def rows_of_fake_sensor(n, n_rest, n_push):
    """What the fake sensor of control_loop.cpp reads."""
    state, rows = 1, np.empty((n, 6))
    for k in range(n):
        moves = k % (n_rest + n_push) >= n_rest
        for axis in range(6):
            state = (6364136223846793005 * state + 1442695040888963407) % 2**64
            noise = (state >> 11) / 2**52 - 1.0
            rows[k, axis] = math.sin(1e-3 * k + axis) + 0.5 * noise if moves else 0.01 * noise
    return rows


@pytest.mark.parametrize("lead_s", [None, 0.1])
def test_example_in_cpp_answers_as_python_with_the_rest(compiled, model, pushes, lead_s, tmp_path):
    """The window begins with the rest before the onset: as long as the model says, or 0.25 s."""
    if lead_s is not None:
        data = pushes.align(trigger="recorded", lead_s=lead_s, duration_s=0.35)
        model = gid.Identifier.fit(data, model.space)
    assert model.lead_s == lead_s
    model.save(tmp_path / "model.safetensors")
    printed = run(
        compiled("examples/c/control_loop.cpp", "-Wconversion"), tmp_path / "model.safetensors", 1.5
    )
    names, texts = zip(*(line.split(": ", 1) for line in printed.splitlines()), strict=True)
    assert names == ("onsets", "pushes", "decisions", "deadlines missed", "last push")
    n_lead = round(500 * (lead_s or 0.25))
    n_cycle = model.n_samples + 50
    rows = rows_of_fake_sensor(750 // n_cycle * n_cycle, n_lead + 50, model.n_samples - n_lead)
    decision = model.identify(rows[-model.n_samples :])
    unknown = "unknown, nearest " if decision.unknown else ""
    assert texts[-1] == f"{unknown}{decision.label}, margin {decision.margin:.6f}"
    assert texts[2].startswith(f"{750 // n_cycle}, ")


@ONE_MODEL
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="preloads what counts, for glibc")
def test_loop_allocates_nothing_and_takes_no_lock(compiled, model_file, tmp_path):
    """A loop of three windows wants of the heap and of locks what a loop of one does."""
    program, counter = compiled("examples/c/control_loop.cpp"), tmp_path / "count.so"
    build = ("cc", "-shared", "-fPIC", "-fno-builtin", *WARNINGS[:3])
    run(*build, ROOT / "tests" / "c" / "count.c", "-o", counter)
    counts = []
    for seconds in ("0.7", "1.9"):
        words, environment = [program, model_file, seconds], os.environ | {"LD_PRELOAD": str(counter)}
        done = subprocess.run(words, check=True, capture_output=True, text=True, env=environment)
        counts.append(done.stderr.splitlines()[-1])
    assert counts[0] == counts[1]
    assert counts[0].endswith("locks 0")


@ONE_MODEL
@pytest.mark.parametrize("options", [(), ("-fsanitize=address,undefined", "-g")], ids=["plain", "sanitized"])
def test_bad_use_ends_in_statuses(options, compiled, model_file):
    run(compiled("tests/c/bad_use.c", *options), model_file)


@ONE_MODEL
def test_bad_use_is_clean_under_valgrind(compiled, model_file):
    needs("valgrind")
    words = ("valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full", "--fair-sched=try")
    # valgrind knows no AVX-512.
    run(*words, compiled("tests/c/bad_use.c"), model_file, env=os.environ | {"GRANULAR_ID_SIMD": "avx2"})


def test_only_functions_with_the_prefix_are_exported(prefix):
    needs("nm")
    library = next(path for path in (prefix / "lib").iterdir() if path.suffix in {".so", ".dylib"})
    option = "--dynamic" if library.suffix == ".so" else "-g"
    lines = run("nm", option, "--defined-only", library).splitlines()
    names = {line.split()[-1].removeprefix("_") for line in lines}
    header = (prefix / "include" / "granular_id.h").read_text(encoding="utf-8")
    assert len(names) == 18
    assert all(f"{name}(" in header for name in names)


@ONE_MODEL
def test_first_program_of_the_docs_names_a_recording(compiled, model, model_file, pushes, tmp_path):
    (text,) = (block.text for block in blocks_of(ROOT / "docs" / "guide" / "c.md") if block.kind == "cpp")
    (tmp_path / "first.cpp").write_text(text, encoding="utf-8")
    rows = " ".join(map(repr, pushes.X[0].ravel().tolist()))
    program = compiled(str(tmp_path / "first.cpp"))
    printed = run(program, model_file, input=rows)
    assert printed.rstrip().endswith(model.identify(pushes.X[0]).label)
    bad = {
        rows[: len(rows) // 2]: "250 rows of 6 numbers",
        rows.replace(" ", ","): "row 0",
        f"nan {rows}": "row 0",
    }
    for text, wanted in bad.items():
        done = subprocess.run([program, model_file], check=False, capture_output=True, text=True, input=text)
        assert done.returncode == 1
        assert wanted in done.stderr
    done = subprocess.run([program], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "usage: first MODEL.safetensors < ROWS\n")


@ONE_MODEL
def test_pkg_config_finds_the_library(prefix, model_file, tmp_path):
    needs("pkg-config")
    environment = os.environ | {"PKG_CONFIG_PATH": str(prefix / "lib" / "pkgconfig")}
    words = ("pkg-config", "--cflags", "--libs", "granular_id")
    program, flags = tmp_path / "loop", run(*words, env=environment).split()
    source = ROOT / "examples" / "c" / "control_loop.cpp"
    run("c++", "-std=c++17", source, "-o", program, *flags, f"-Wl,-rpath,{prefix / 'lib'}", "-pthread")
    assert "last push" in run(program, model_file, 1.1)
    assert run("pkg-config", "--modversion", "granular_id", env=environment).strip() == gid.__version__


PROJECT = """
cmake_minimum_required(VERSION 3.16)
project(controller CXX)
find_package(granular_id 0.1 REQUIRED)
find_package(Threads REQUIRED)
foreach(kind granular_id static)
  add_executable(loop_${kind} SOURCE)
  target_compile_features(loop_${kind} PRIVATE cxx_std_17)
  target_link_libraries(loop_${kind} PRIVATE granular_id::${kind} Threads::Threads)
endforeach()
"""


@ONE_MODEL
def test_cmake_finds_the_library(prefix, model_file, tmp_path):
    needs("cmake")
    source = ROOT / "examples" / "c" / "control_loop.cpp"
    (tmp_path / "CMakeLists.txt").write_text(PROJECT.replace("SOURCE", str(source)))
    run("cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", tmp_path / "build")
    for kind in ("granular_id", "static"):
        assert "last push" in run(tmp_path / "build" / f"loop_{kind}", model_file, 1.1)


def test_cmake_takes_versions_of_the_same_minor(prefix, tmp_path):
    needs("cmake")
    made = prefix / "lib" / "cmake" / "granular_id" / "granular_id-config-version.cmake"
    folder = tmp_path / "lib" / "cmake" / "granular_id"
    folder.mkdir(parents=True)
    text = made.read_text().replace(f"set(PACKAGE_VERSION {gid.__version__})", "set(PACKAGE_VERSION 1.2.3)")
    (folder / made.name).write_text(text)
    (folder / "granular_id-config.cmake").touch()
    wanted = {"": 1, "1.2": 1, "1.2.0": 1, "1.2.3": 1, "1.2.3 EXACT": 1, "1.2.2 EXACT": 0}
    wanted |= dict.fromkeys(["1.2.4", "1.1", "1.3", "1.20", "2.2", "0.0.9", "1"], 0)
    script = "".join(
        f"find_package(granular_id {version} QUIET CONFIG)\nmessage(STATUS ${{granular_id_FOUND}})\n"
        for version in wanted
    )
    (tmp_path / "find.cmake").write_text(script)
    printed = run("cmake", f"-DCMAKE_PREFIX_PATH={tmp_path}", "-P", tmp_path / "find.cmake")
    assert printed.split() == [word for found in wanted.values() for word in ("--", str(found))]


def test_install_without_a_library_is_refused(tmp_path):
    script, environment = (
        ROOT / "rust" / "c" / "install.sh",
        {**os.environ, "CARGO_TARGET_DIR": str(tmp_path)},
    )
    for build in ((), (tmp_path / "nowhere",)):
        words = [script, tmp_path / "prefix", *build]
        done = subprocess.run(words, check=False, capture_output=True, text=True, env=environment)
        assert (done.returncode, f"no libgranular_id_c in {tmp_path}" in done.stderr) == (1, True)
        assert not (tmp_path / "prefix").exists()
    (tmp_path / "release").mkdir()
    (tmp_path / "release" / "libgranular_id_c.a").touch()
    run(script, tmp_path / "prefix", env=environment)
    assert (tmp_path / "prefix" / "lib" / "libgranular_id_c.a").exists()
