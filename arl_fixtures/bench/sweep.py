"""One sweep: turn the stage angle by angle and take every DUT's frames while it stands still."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from arl_fixtures.bench.bench import Bench
from arl_fixtures.devices.dut_status import DutError
from arl_fixtures.metrics.block import AngleBlock


class AngleRecord(NamedTuple):
    """All DUTs at one stage angle."""

    angle_index: int
    stage_angle_deg: float
    time_ns: int
    blocks: dict[str, AngleBlock]


def sweep(
    bench: Bench,
    angles_deg: Sequence[float],
    *,
    frames: int,
    between: Callable[[], None] = lambda: None,
    lose: Callable[[DutError], None] | None = None,
) -> Iterator[AngleRecord]:
    """Drive through `angles_deg`, yield what was recorded at each, and return to the first angle.

    Frames count only if their exposure began after the stage reported that it stands. Whatever needs no standing
    stage is done while it moves on: the temperature control, what the caller does with a record, and `between`, which
    runs once per angle (interlock, progress). `lose` is told of DUTs that stopped delivering: it raises, or the sweep
    goes on without them as long as there are others.

    Raises:
        DeviceError: the stage does not arrive, or a DUT is silent; the message names it.
    """
    settings, clock, stage = bench.config.sweep, bench.clock, bench.stage
    serials = bench.serials
    recorded: AngleRecord | None = None
    for index, angle_deg in enumerate(angles_deg):
        stage.move_to_deg(angle_deg)
        if recorded is not None:
            yield recorded
            between()
        bench.turn()
        not_before_s = stage.wait_until_reached(settings.move_timeout_s, bench.look) + settings.rest_s
        actual_deg = stage.position_deg()
        try:
            blocks = bench.duts.collect(
                serials,
                frames,
                not_before_s=not_before_s,
                timeout_s=settings.rest_s + frames * settings.frame_period_s + settings.frames_timeout_s,
                angle_index=index,
                stage_angle_deg=actual_deg,
                idle=bench.look,
            )
        except DutError as error:
            serials = tuple(serial for serial in serials if serial not in error.serials)
            if lose is None or not serials:
                raise
            lose(error)
            blocks = dict(error.blocks)
        recorded = AngleRecord(index, actual_deg, clock.utc_ns(), blocks)
    if recorded is not None:
        stage.move_to_deg(angles_deg[0])
        yield recorded
        between()
        stage.wait_until_reached(settings.move_timeout_s, bench.look)
