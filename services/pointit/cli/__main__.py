"""Run the command line: `python -m pointit.cli`."""

from pointit.cli.main import main

main()
