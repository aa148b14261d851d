"""Run the command line as `python -m emseg`."""

from emseg.cli import main

main()
