"""``python -m granular_id`` is ``granular-id``."""

from granular_id.cli import main

main()
