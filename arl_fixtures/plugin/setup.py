"""The files of a session, read and checked before anything is switched on."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import pytest

from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.bench.profile import Profile, load_profile, profile_path
from arl_fixtures.metrics.limits import LimitSet, check_metrics, load_limits
from arl_fixtures.metrics.registry import metric_names, metric_units
from arl_fixtures.plugin.campaign import CampaignFile, StopRules
from arl_fixtures.plugin.options import Options
from arl_fixtures.yaml_model import load_model

WALL_MARGIN: Final = 1.5
WALL_ALLOWANCE_S: Final = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFiles:
    """What the user's options stand for.

    Attributes:
        options: as given.
        bench, profile, limits: the files' content.
        hashes: SHA-256 of `bench`, `profile`, `limits`.
        allure_folder: where Allure results go; empty when they are not collected.
        stop: what ends the campaign early.
    """

    options: Options
    bench: BenchConfig
    profile: Profile
    limits: LimitSet
    hashes: Mapping[str, str]
    allure_folder: str = ""
    stop: StopRules = field(default_factory=StopRules)


SESSION_KEY: Final = pytest.StashKey[SessionFiles]()


def check_files(options: Options, allure_folder: str = "") -> SessionFiles:
    """Read bench, profile and limits.

    Raises:
        ConfigError: with file, line and column of each fault.
    """
    bench = load_bench(options.bench)
    profile = load_profile(options.profile)
    limits = load_limits(options.limits)
    check_metrics(limits, metric_names(), metric_units(), options.limits)
    return SessionFiles(
        options=options,
        allure_folder=allure_folder,
        stop=load_model(options.campaign, CampaignFile).stop if options.campaign is not None else StopRules(),
        bench=bench,
        profile=profile,
        limits=limits,
        hashes={
            "bench": bench.sha256,
            "profile": hashlib.sha256(profile_path(options.profile).read_bytes()).hexdigest(),
            "limits": hashlib.sha256(options.limits.read_bytes()).hexdigest(),
        },
    )


def step_timeout_s(files: SessionFiles) -> float:
    """How long one step may take on the wall clock: all its attempts at their time limits, and a margin."""
    sweep, profile = files.bench.sweep, files.profile
    angles = len(profile.angles.angles_deg(0)) + 1
    per_angle_s = sweep.move_timeout_s / 10 + profile.frames * sweep.frame_period_s + sweep.frames_timeout_s
    once_s = files.bench.settle.time_limit_s + profile.soak_s + angles * per_angle_s
    return WALL_MARGIN * 3 * once_s + WALL_ALLOWANCE_S
