"""Entry point of `python -m skinnet.cli`."""

from skinnet.cli.main import main

main()
