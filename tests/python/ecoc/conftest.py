import pytest

from granular_id.ecoc import codings


@pytest.fixture(scope="class")
def few_draws():
    """Random designs are the best of 20 draws instead of 10,000."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(codings, "_DRAWS", 20)
        yield
