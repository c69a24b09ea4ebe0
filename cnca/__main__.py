"""``python -m cnca`` is the ``cnca`` command."""

from cnca.cli import main

main()
