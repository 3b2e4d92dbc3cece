"""DUT files: what is refused, and what the defaults are."""

import pytest
from pydantic import ValidationError

from arl_fixtures.errors import ConfigError
from arl_fixtures.twin.settings import DutSettings
from arl_fixtures.yaml_model import load_model


def test_a_dut_file_is_read(tmp_path):
    path = tmp_path / "dut.yaml"
    path.write_text(
        "serial: SN-1\nsender_address: 192.168.10.21\nheight_m: 0.1\ngain: 0.98\n"
        "intrinsics: {fx: 58.2, k4: 0.199}\ndead_pixels: [[3, 4], [100, 31]]\n"
        "beam: {azimuth_half_width_deg: 74}\npatches: [{u: [1, 2], v: [3, 4], factor: 0.95}]\n"
        "aging: {power_per_cycle: -1e-3}\nseed: 3\n"
    )
    dut = load_model(path, DutSettings)
    assert dut.intrinsics.fx == 58.2
    assert dut.intrinsics.fy == 66.0
    assert dut.dead_pixels == ((3, 4), (100, 31))
    assert dut.aging.power_per_cycle == -0.001


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("serial: S\nintrinsics: {fxx: 1}\n", ":2:14:", "did you mean 'fx'"),
        ("serial: S\nsender_address: nowhere\n", ":2:17:", "IPv4"),
        ("serial: S\ndead_pixels: [[1, -2]]\n", ":2:14:", "outside the image of 128 x 32"),
        ("serial: S\ndead_pixels: [[128, 0]]\n", ":2:14:", "dead pixel (u 128, v 0)"),
        ("serial: S\nfield_samples: 2\n", ":2:16:", "1, 3, 5, 7 or 9"),
        ("serial: S\ngain: .nan\n", ":2:7:", "finite number"),
        ("serial: S\nbeam: {exponent: .inf}\n", ":2:18:", "finite number"),
        ("gain: 1\n", "", "'serial' is missing"),
    ],
)
def test_faults_of_a_dut_file_are_named_with_their_place(tmp_path, text, place, said):
    path = tmp_path / "dut.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_model(path, DutSettings)
    assert place in str(error.value)
    assert said in str(error.value)


@pytest.mark.parametrize("serial", ["", "Ä1", "two\nlines", "x" * 27])
def test_serial_numbers_must_fit_the_telemetry(serial):
    with pytest.raises(ValidationError):
        DutSettings(serial=serial)
