"""Linear algebra runs in one thread, so that values measured again are those of the session on any machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

THREADS = "OPENBLAS_NUM_THREADS"


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_one_thread_unless_another_number_is_given(given, used):
    environment = {name: value for name, value in os.environ.items() if name != THREADS}
    if given is not None:
        environment[THREADS] = given
    code = (
        "import sys, os, arl_fixtures\n"
        "assert 'numpy' not in sys.modules, 'too late: numpy has read it'\n"
        f"import arl_fixtures.metrics.registry; print(os.environ['{THREADS}'])"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == (used, "")
