"""``python -m posefuse``."""

from posefuse.cli.main import main

main()
