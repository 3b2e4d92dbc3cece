"""`python -m arl_fixtures.cli` is `arl`."""

from arl_fixtures.cli import main

main()
