"""The mocked fixtures, by the names of the real ones."""

from arl_fixtures.testing import bench, chiller, clock, duts, relays, stage, thermometer, twin  # noqa: F401 - fixtures
