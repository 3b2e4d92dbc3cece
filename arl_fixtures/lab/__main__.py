"""`python -m arl_fixtures.lab`."""

from arl_fixtures.lab.run import main

raise SystemExit(main())
