"""A name gives way to another channel's law only where the channel in question is all that it acts in."""

from types import SimpleNamespace

import pytest

from arl_fixtures.reconcile.told_elsewhere import drop_told_elsewhere


@pytest.mark.parametrize(
    ("moves", "gain", "falls"),
    [
        ({"distance_m"}, -1.0, True),
        ({"distance_m"}, -5.0, False),
        ({"distance_m", "ambient_counts"}, -1.0, False),
    ],
    ids=["as good a law", "a worse law", "borne out elsewhere"],
)
def test_a_name_of_one_channel_gives_way_to_a_law_that_says_as_much(moves, gain, falls):
    term = SimpleNamespace(variant=SimpleNamespace(drivers=("tof_temperature_c",)))
    law = SimpleNamespace(channel="intensity_counts", terms=[1], drivers=["irradiance_w_m2"])
    kept = []
    names = ("distance_m", "intensity_counts", "ambient_counts")
    decision = SimpleNamespace(
        problem=SimpleNamespace(data=[SimpleNamespace(channel=SimpleNamespace(name=n)) for n in names]),
        best=SimpleNamespace(terms=[term]), laws=[law], energy=lambda _: dict.fromkeys(moves, 9.0),
        standing=SimpleNamespace(instead_of=lambda *_: (SimpleNamespace(drivers=["irradiance_w_m2"]), gain)),
        keep=kept.append, look=lambda: None,
    )  # fmt: skip
    assert drop_told_elsewhere(decision) is falls
    assert kept == ([()] if falls else [])
