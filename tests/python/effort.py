"""How much a test tries: little in every run, as many cases as ``GRANULAR_ID_CASES`` says where it is set."""

import os
from typing import TypeVar

Kinds = TypeVar("Kinds")
_CASES = os.environ.get("GRANULAR_ID_CASES")


def cases(normally: int) -> int:
    return int(_CASES or normally)


def kinds(normally: Kinds, long: Kinds) -> Kinds:
    return long if _CASES else normally
