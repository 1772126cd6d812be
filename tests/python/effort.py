"""How many random cases a test tries: few in every run, as many as ``GRANULAR_ID_CASES`` says where it is set."""

import os


def cases(normally: int) -> int:
    return int(os.environ.get("GRANULAR_ID_CASES", normally))
