"""A session in a process of its own, whose robot notes its calls, to be ended by a signal."""

import os
import subprocess
import sys
import threading
from pathlib import Path

SCRIPT = Path(__file__).parent / "live" / "signals_work.py"


class Session:
    """A session in a process of its own; `notes` is what its robot has noted."""

    def __init__(self, folder, how, *words, **options):
        self.folder, self.notes = folder / "data", []
        read, write = os.pipe()
        piped = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        words = map(str, [sys.executable, SCRIPT, write, how, *(words or (self.folder,))])
        self.process = subprocess.Popen([*words], text=True, pass_fds=[write], **(piped | options))
        os.close(write)
        self.lines = os.fdopen(read, encoding="utf-8")
        self.limit = threading.Timer(60, self.process.kill)  # a test that waits for a note in vain fails
        self.limit.start()

    def wait_for(self, what):
        for line in self.lines:
            self.notes.append(line.rstrip())
            if self.notes[-1] == what:
                return
        raise AssertionError(self.process.communicate())

    def signal(self, number):
        """Send a signal while the tool moves, and wait for stop()."""
        self.wait_for("moves")
        self.process.send_signal(number)
        self.wait_for("stop")

    def ended(self):
        """Wait for its end; return the exit code and what it wrote about errors."""
        _, err = self.process.communicate(timeout=60)
        self.notes += self.lines.read().splitlines()
        assert "stop" in self.notes
        assert self.notes.count("moves") == 1
        assert not [path for path in self.folder.rglob("*") if path.is_file()]
        return self.process.returncode, err
