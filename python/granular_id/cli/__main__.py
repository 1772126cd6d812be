"""``python -m granular_id.cli`` is ``granular-id``."""

from granular_id.cli import main

main()
