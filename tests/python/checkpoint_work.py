"""Run as a program, to be killed: ``checkpoint_work.py FOLDER RESULT STOP``.

Evaluates the small data set with a checkpoint. The write number STOP kills the process with half a file written
(SIGKILL: nothing is cleaned up); with STOP 0 it goes on to the end and writes the result.
"""

import os
import signal
import sys
from contextlib import contextmanager

from evaluation_cases import SMALL, make_data
from granular_id.evaluation import checkpoint, evaluate

ARGUMENTS = {**SMALL, "controls": True, "spaces": ["raw+hfmh", "pca"], "protocol": "auto"}


def run(folder, **changes):
    return evaluate(make_data(), checkpoint=folder, **{**ARGUMENTS, **changes})


def main():
    folder, result, stop = sys.argv[1], sys.argv[2], int(sys.argv[3])
    original, written = checkpoint.whole_file, 0

    @contextmanager
    def deadly(path):
        nonlocal written
        written += 1
        with original(path) as draft:
            if written == stop:
                draft.write_text('{"predicted": [0, 1')
                os.kill(os.getpid(), signal.SIGKILL)
            yield draft

    checkpoint.whole_file = deadly
    run(folder).to_json(result)


if __name__ == "__main__":
    main()
