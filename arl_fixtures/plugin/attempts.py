"""Attempts at a step: what failed is repeated, a pause waited for, a stop ends the session; all is journalled."""

from __future__ import annotations

from typing import Final, final

from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.dut_status import OtherDutError
from arl_fixtures.errors import ArlError, DeviceError, HoldError, InterlockError, StorageError
from arl_fixtures.guard.guarding import Guard
from arl_fixtures.journal.journal import Journal
from arl_fixtures.plugin import journaling
from arl_fixtures.plugin.outcome import StepInvalidError
from arl_fixtures.plugin.progress import Progress
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import StepResult, StepRunner

ATTEMPTS: Final = 3
"""A step that fails to finish this often is INVALID and the cycle goes on."""
RECOVERY_S: Final = 300.0
"""How long a bench that broke down is waited for, on the bench clock."""
RECOVERY_PAUSE_S: Final = 10.0


@final
class SessionOverError(ArlError):
    """No further step can run; the message says why."""


@final
class Attempts:
    """Runs steps until they finish.

    Args:
        runner: does one attempt.
        files: bench, limits, output folder.
        past: attempts of an interrupted session count, too.
        journal: open.
        progress: told how it goes on.
        guard: asked before each attempt; None without one.
    """

    def __init__(
        self,
        runner: StepRunner,
        files: SessionFiles,
        past: Past,
        *,
        journal: Journal,
        progress: Progress,
        guard: Guard | None = None,
    ) -> None:
        self._runner, self._bench, self._files, self._past = runner, runner.bench, files, past
        self._journal, self._progress, self._guard = journal, progress, guard

    def run(self, step: CycleStep) -> StepResult:
        """One step, again where a device failed or the guard paused it, at most `ATTEMPTS` times in all.

        Raises:
            StepInvalidError: it did not finish.
            SessionOverError: the bench is stopped or broken, or nothing can be recorded.
        """
        failures = self._past.failures(step.id)
        try:
            while len(failures) < ATTEMPTS:
                attempt = len(failures) + 1
                self._wait_until_allowed()
                try:
                    return self._attempt(step, attempt)
                except OtherDutError as error:
                    raise SessionOverError(f"further steps are NOT RUN: {error}") from None
                except DeviceError as error:
                    failures.append(f"attempt {attempt}: {error}")
                    self._recover(error)
                except HoldError as error:
                    failures.append(f"attempt {attempt}: paused: {error}")
        except InterlockError as error:
            actions = self._guard.actions if self._guard is not None else ()
            self._journal.append(journaling.safe_stop(error, actions))
            raise SessionOverError(f"the bench is stopped, further steps are NOT RUN: {error}") from None
        except StorageError as error:
            # what cannot be written would be lost at the next step too
            raise SessionOverError(f"nothing can be recorded, further steps are NOT RUN: {error}") from None
        raise StepInvalidError("INVALID: " + "; ".join(failures))

    def _attempt(self, step: CycleStep, attempt: int) -> StepResult:
        self._journal.append(journaling.step_begin(step, attempt))
        self._bench.enter_step(step)
        try:
            result = self._runner.run(step, attempt, self._progress, last=attempt >= ATTEMPTS)
        except BaseException as error:
            reason = str(error) or type(error).__name__
            self._journal.append(journaling.broken_off(step, attempt, reason))
            raise
        self._journal.append_many(journaling.outcome(result, self._files.options.out, self._files.limits))
        return result

    def _wait_until_allowed(self) -> None:
        """Pause as long as the guard wants it.

        Raises:
            InterlockError: the bench was made safe.
        """
        if self._guard is None:
            return
        while True:
            try:
                self._guard.check()
            except HoldError as error:
                self._journal.append(journaling.pause(error))
                self._home_if_stage_asks()
                paused_s = self._guard.wait_until_clear(self._bench)
                self._journal.append(journaling.pause_over(paused_s))
            else:
                return

    def _home_if_stage_asks(self) -> None:
        """A stage keeps its fault until it is homed, and nobody else will do that."""
        try:
            if self._bench.stage.fault():
                self._bench.home()
        except DeviceError as error:
            self._journal.append(journaling.fault(error, "pause goes on"))

    def _recover(self, error: DeviceError) -> None:
        """Bring the bench back for another attempt, with patience: a supply or a network may be down for a while.

        Raises:
            InterlockError: the guard has lost patience before; its conditions are in the bench file.
            SessionOverError: it does not come back.
        """
        self._journal.append(journaling.fault(error, "bench started anew for another attempt"))
        clock, bench = self._bench.clock, self._bench
        deadline_s = clock.now_s + RECOVERY_S
        while True:
            try:
                bench.stage.stop()
                bench.start()
                bench.read()
            except DeviceError as again:
                if clock.now_s >= deadline_s:
                    self._journal.append(journaling.fault(again, "session ended, bench made safe"))
                    message = f"the bench does not come back within {RECOVERY_S:g} s, further steps are NOT RUN: "
                    raise SessionOverError(message + str(again)) from None
                bench.wait(RECOVERY_PAUSE_S)
            except HoldError:
                # it answers; the pause is waited for before the next attempt
                return
            else:
                return
