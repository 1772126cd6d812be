"""What several files here use: bits compared, functions called at once, programs on their own, streams filled."""

import subprocess
import sys
import threading

import numpy as np

N_THREADS = 8


def same_bits(a, b):
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    return a.shape == b.shape and a.dtype == b.dtype == np.float64 and a.tobytes() == b.tobytes()


def at_once(functions):
    """Results of functions that threads call at the same moment, in their order."""
    results = [None] * len(functions)
    errors = []
    gate = threading.Barrier(len(functions))

    def run(n, function):
        try:
            gate.wait()
            results[n] = function()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run, args=pair) for pair in enumerate(functions)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    return results


def printed_by(program, *arguments, **environment):
    """What a program prints in a process of its own, which must live to its end."""
    command = [sys.executable, "-c", program, *arguments]
    child = subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=300, env=environment or None
    )
    assert child.returncode == 0, child.stdout[-1000:] + child.stderr[-2000:]
    return child.stdout


def fill(stream, rows, blocks):
    """Push blocks until the window is complete or the rows are used up; how many were taken."""
    taken = step = 0
    while taken < len(rows) and not stream.is_complete:
        size = 1 if step % (len(blocks) + 1) == len(blocks) else blocks[step % (len(blocks) + 1)]
        taken += stream.push(rows[taken : taken + size])
        step += 1
    return taken
