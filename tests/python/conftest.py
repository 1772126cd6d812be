import os
import shutil
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# One thread of linear algebra: on matrices as small as those of the tests, several wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# a busy machine must not fail a test: hypothesis' limit of 200 ms per example is off
settings.register_profile("granular_id", deadline=None)
settings.load_profile("granular_id")

REAL = ("sliding_wrench", "sand_press")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings, which is no part of the project: see the ``data`` marker."""
    folder = os.environ.get("GRANULAR_ID_DATA")
    missing = [name for name in REAL if not folder or not Path(folder, name).is_dir()]
    if missing:
        pytest.skip(
            f"no real recordings ({', '.join(missing)}): docs/guide/features.md and CONTRIBUTING.md say where they "
            "come from, GRANULAR_ID_DATA where they are"
        )
    return Path(folder)


@pytest.fixture
def heeding_interrupts():
    """Undo what shells and nohup do to programs in the background: their children would ignore these signals, too."""
    before = {signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler)}
    if hasattr(signal, "SIGHUP"):
        before[signal.SIGHUP] = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def begin(tmp_path):
    """Begin a session; it does not outlive the test."""
    from stopping_cases import Session

    sessions = []

    def one(how, *words, **options):
        sessions.append(Session(tmp_path, how, *words, **options))
        return sessions[-1]

    yield one
    for session in sessions:
        session.limit.cancel()
        session.process.kill()
        session.process.communicate()
        session.lines.close()


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield running
        running.close()
