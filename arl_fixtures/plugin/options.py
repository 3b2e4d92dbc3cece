"""The pytest options of the bench, each with an ini default so that a project sets them once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from arl_fixtures.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What the user asked for, paths resolved against the project's root."""

    bench: str
    profile: str
    limits: Path
    out: Path
    cycles: int
    first_cycle: int | None
    resume: bool
    lab: Path | None = None
    campaign: Path | None = None


def add_options(parser: pytest.Parser) -> None:
    """Declare options and their ini twins."""
    group = parser.getgroup("arl", "LiDAR aging bench")
    group.addoption("--bench", metavar="FILE", help="bench file, or the name of a bench that comes with the package")
    group.addoption("--profile", metavar="FILE", help="profile file, or the name of a built-in profile")
    group.addoption("--limits", metavar="FILE", help="limits file, or the name of built-in limits")
    group.addoption("--out", metavar="FOLDER", help="where bags, journal and reports go")
    group.addoption("--cycles", type=int, metavar="N", help="number of cycles to run (default 1)")
    group.addoption("--campaign", metavar="FILE", help="campaign file: cycles, and what ends them early")
    group.addoption("--first-cycle", type=int, metavar="N", help="cycle count of the first cycle (default: next)")
    group.addoption("--resume", action="store_true", help="go on where the newest journal in the output folder ended")
    group.addoption("--lab", metavar="SOCKET", help="socket of the lab that holds the emulated hardware")
    parser.addini("arl_bench", "default of --bench", default="emulated")
    parser.addini("arl_profile", "default of --profile", default="short")
    parser.addini("arl_limits", "default of --limits", default="default")
    parser.addini("arl_out", "default of --out", default="out")


def read_options(config: pytest.Config) -> Options:
    """Options of this session.

    Raises:
        pytest.UsageError: a number that makes no sense, or no such limits.
    """
    from arl_fixtures.metrics.limits import limits_path  # a plain pytest session does not pay for it

    def text(name: str) -> str:
        return str(config.getoption(f"--{name}") or config.getini(f"arl_{name}"))

    def path(name: str) -> Path | None:
        given = config.getoption(f"--{name}")
        return config.rootpath / given if given else None

    def count(name: str, least: int) -> int | None:
        value = config.getoption(name)
        if value is not None and value < least:
            raise pytest.UsageError(f"{name} {value}: expected at least {least}")
        return None if value is None else int(value)

    try:
        limits = limits_path(_here(config, text("limits")))
    except ConfigError as error:
        raise pytest.UsageError(str(error)) from None
    return Options(
        bench=_here(config, text("bench")),
        profile=_here(config, text("profile")),
        limits=limits,
        out=config.rootpath / text("out"),
        cycles=count("--cycles", 1) or 1,
        first_cycle=count("--first-cycle", 0),
        resume=bool(config.getoption("--resume")),
        lab=path("lab"),
        campaign=path("campaign"),
    )


def _here(config: pytest.Config, name_or_path: str) -> str:
    is_file = name_or_path.endswith((".yaml", ".yml"))
    return str(config.rootpath / name_or_path) if is_file else name_or_path


def allure_folder(config: pytest.Config) -> str:
    """Where Allure results go; empty when they are not collected."""
    return str(config.getoption("--alluredir", default=None) or "")
