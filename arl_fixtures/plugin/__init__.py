"""The pytest plugin: options, fixtures, one test per temperature step, outcome and reports.

It is loaded by every pytest run where it is installed, so it imports next to nothing until a cycle is asked for.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import pytest

from arl_fixtures.errors import ArlError
from arl_fixtures.plugin import fixtures
from arl_fixtures.plugin.options import add_options, allure_folder, read_options

if TYPE_CHECKING:
    from _pytest._code.code import TracebackEntry

    from arl_fixtures.bench.profile import CycleStep

STEPS_KEY: pytest.StashKey[list[CycleStep]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the bench's options."""
    add_options(parser)


def pytest_configure(config: pytest.Config) -> None:
    """Declare the markers; end like Ctrl-C on SIGTERM and SIGHUP, which pytest alone would not survive.

    Ctrl-C itself waits, as they do, while a lock is taken or given back, see `_end_like_ctrl_c`.
    """
    config.addinivalue_line("markers", "cycle: a full aging cycle on the bench")
    config.pluginmanager.register(fixtures, "arl_fixtures_fixtures")
    if getattr(config, "workerinput", None) is None:
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _end_like_ctrl_c)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _end_like_ctrl_c)


_TAKING = frozenset(method.__code__ for method in (threading.Condition.__enter__, threading.Condition.__exit__))
"""Steps of a lock in Python: an exception between them leaves it taken, and whoever closes a file waits for ever."""


def _end_like_ctrl_c(number: int, frame: FrameType | None) -> None:
    inner = frame
    while inner is not None:
        if inner.f_code in _TAKING:
            _thread.start_new_thread(os.kill, (os.getpid(), number))  # again when the lock's step is done
            return
        inner = inner.f_back
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise KeyboardInterrupt(f"signal {signal.Signals(number).name}")


@pytest.hookimpl(tryfirst=True)
def pytest_keyboard_interrupt(excinfo: pytest.ExceptionInfo[BaseException]) -> None:
    """Leave out frames without a line: a signal may come between two lines, where pytest fails to tell of it.

    Python 3.11 gives such a frame no line number; a session that is interrupted ends with status 2 all the same.
    """
    excinfo.traceback = excinfo.traceback.filter(_has_a_line)


def _has_a_line(entry: TracebackEntry) -> bool:
    try:
        return entry.lineno >= 0
    except TypeError:
        return False


def pytest_collection(session: pytest.Session) -> None:
    """Check profile and cycle counts before anything is collected: here a complaint is one line."""
    if not _runs_cycles(session.config):
        return
    from arl_fixtures.bench.profile import load_profile
    from arl_fixtures.plugin.campaign import session_cycles

    options = read_options(session.config)
    try:
        profile = load_profile(options.profile)
        session.config.stash[STEPS_KEY] = [step for cycle in session_cycles(options) for step in profile.steps(cycle)]
    except ArlError as error:
        raise pytest.UsageError(str(error)) from None


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test per temperature step, for every test that asks for `cycle_step`."""
    if "cycle_step" in metafunc.fixturenames:
        # collected but not selected there is nothing to parametrise with, whatever the output folder holds
        steps = metafunc.config.stash.get(STEPS_KEY, [])
        metafunc.parametrize("cycle_step", steps, ids=[step.id for step in steps], scope="session")


def _runs_cycles(config: pytest.Config) -> bool:
    return bool(config.option.markexpr) and "not cycle" not in config.option.markexpr


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give every step a limit on the wall clock, so that a hanging bench ends the step."""
    cycle_items = [item for item in items if item.get_closest_marker("cycle")]
    if cycle_items and _runs_cycles(config):
        from arl_fixtures.plugin.setup import SESSION_KEY, check_files, step_timeout_s

        try:
            files = check_files(read_options(config), allure_folder(config))
        except ArlError as error:
            raise pytest.UsageError(str(error)) from None
        config.stash[SESSION_KEY] = files
        for item in cycle_items:
            if not item.get_closest_marker("timeout"):
                item.add_marker(pytest.mark.timeout(step_timeout_s(files)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show what we raise on purpose as its message, without a traceback."""
    report = yield
    error: Any = call.excinfo.value if call.excinfo else None
    ours = isinstance(error, ArlError) or type(error).__name__ == "StepFailedError"
    if ours and item.get_closest_marker("cycle"):
        report.longrepr = str(error)
    return report


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Leave Allure's environment and categories beside its results."""
    if "arl_fixtures.plugin.setup" not in sys.modules:
        return
    from arl_fixtures.plugin.allure_output import write_environment
    from arl_fixtures.plugin.setup import SESSION_KEY

    files = session.config.stash.get(SESSION_KEY, None)
    if files is not None and files.allure_folder and Path(files.allure_folder).is_dir():
        write_environment(Path(files.allure_folder), files)
