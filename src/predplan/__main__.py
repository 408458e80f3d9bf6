"""`python -m predplan` is the command line."""

from predplan.cli import main

main()
