"""`python -m arl_fixtures.guard`."""

from arl_fixtures.guard.run import main

raise SystemExit(main())
