"""Names that are seldom asked for, each made from pulses, patches, exposures or convolutions."""

import numpy as np

from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.reconcile import diagnose

LIGHT_M_NS = 0.299792458


def columns_of(numbers, **categories):
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    codes = {
        name: (np.unique(values, return_inverse=True)[1].astype(np.int64), tuple(np.unique(values)))
        for name, values in categories.items()
    }
    n = len(next(iter(numbers.values())))
    return Columns(n=n, numbers=numbers, categories=codes, channels=find_channels(set(numbers)))


def grid(*axes):
    return [axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")]


# ---- a floor below the beam ---------------------------------------------------------------------------------------


def echo(range_m, height_m, albedo):
    """Range error and light of a pulse and what comes by way of a floor, patch by patch; a receiver sees cos^6."""
    time = np.arange(-4.0, 16.0, 0.05)
    pulse = np.exp(-0.5 * (time / 1.0) ** 2)
    ahead, aside = np.meshgrid(np.linspace(0.02, range_m - 0.02, 60), np.linspace(-1.5, 1.5, 31), indexing="ij")
    patch = (ahead[1, 0] - ahead[0, 0]) * (aside[0, 1] - aside[0, 0])
    to_floor = np.sqrt((range_m - ahead) ** 2 + aside**2 + height_m**2)
    to_eye = np.sqrt(ahead**2 + aside**2 + height_m**2)
    lit = (range_m - ahead) / to_floor * height_m / to_floor**3 / np.pi
    seen = height_m / to_eye**3 / np.pi * (ahead / to_eye) ** 6 * patch * np.pi * range_m**2
    late = (to_floor + to_eye - range_m) / LIGHT_M_NS
    late_ns = np.arange(0.0, 12.0, 0.1)
    light = np.histogram(late, bins=np.append(late_ns, 12.1) - 0.05, weights=albedo * lit * seen)[0]
    wave = pulse + sum(
        part * np.interp(time - at, time, pulse) for part, at in zip(light, late_ns, strict=True) if part
    )
    top = np.maximum(wave - 0.3 * wave.max(), 0.0)
    return 0.5 * LIGHT_M_NS * (top @ time) / top.sum(), wave.sum() / pulse.sum()


def rail(albedo, seed=4):
    rng = np.random.default_rng(seed)
    ranges = np.array([0.8, 1.1, 1.5, 2.0, 2.6, 3.3, 4.1, 5.0, 6.2, 8.0, 11.0, 15.0])
    heights = np.array([0.3, 1.1])
    table = np.array([[echo(r, h, albedo) for h in heights] for r in ranges])
    sweep, stop, level, white = grid(np.arange(14), np.arange(ranges.size), np.arange(2), np.arange(2))
    longer, grown = table[stop, level].T
    far, light = ranges[stop], 4000.0 * np.array([0.2, 0.8])[white] / ranges[stop] ** 2
    noise, blur = np.sqrt(1.2 * light + 9.0), np.full(far.size, 0.003)
    return columns_of(
        {
            "cycle": sweep, "step": stop, "time_s": 400.0 * sweep + 20.0 * stop + 5.0 * level + white,
            "true_range_m": far, "beam_height_m": heights[level], "reflectance": np.array([0.2, 0.8])[white],
            "n_frames": np.full(far.size, 10.0), "sim_signal_counts": light, "sim_signal_counts_std": noise,
            "sim_distance_m": far, "sim_distance_m_std": blur,
            "signal_counts": light * grown + rng.normal(0.0, noise / np.sqrt(10.0)),
            "distance_m": far + longer + rng.normal(0.0, blur / np.sqrt(10.0)),
        },
        surface=np.array(["grey", "white"])[white],
    )  # fmt: skip


def test_light_by_way_of_a_floor_below_a_beam_of_known_height():
    (found,) = diagnose(rail(0.2))[0].findings
    assert found.effect == "air.multipath"
    assert "beam_height_m" in found.drivers
    values = {p.name: p for p in found.parameters}
    assert 0.15 < values["share"].value < 0.25  # the floor's albedo
    assert 4.0 < values["lobe"].value < 9.0  # of the receiver's cosine to the sixth power


def test_a_black_floor_is_no_finding():
    assert diagnose(rail(0.0))[0].findings == []


# ---- a mirror's reading that lags ---------------------------------------------------------------------------------


def autocollimator(stale, seed=5):
    """Readings of four hundred exposures each, the first of which were taken before the stage had moved."""
    rng = np.random.default_rng(seed)
    place, shown = np.zeros(0), np.zeros(0)
    for _ in range(14):
        angles = rng.permutation(np.arange(-30.0, 31.0, 5.0))
        before = np.concatenate([[angles[0]], angles[:-1]])
        exposures = np.where(np.arange(400) < 400 * stale, before[:, None], angles[:, None])
        place, shown = np.append(place, angles), np.append(shown, exposures.mean(axis=1))
    stays = np.arange(place.size)
    blur = np.full(place.size, 0.02)
    return columns_of({
        "step": stays // 13, "time_s": 15.0 * stays, "stage_angle_deg": place, "n_frames": np.ones(place.size),
        "sim_mirror_angle_deg": place, "sim_mirror_angle_deg_std": blur,
        "mirror_angle_deg": shown + rng.normal(0.0, blur),
    })  # fmt: skip


def test_readings_that_hold_some_of_the_angle_before_lag_and_are_no_backlash():
    (found,) = diagnose(autocollimator(0.0025))[0].findings
    assert found.effect == "acquisition.frame_lag"
    share = next(p for p in found.parameters if p.name == "share")
    assert share.low < 0.0025 < share.high


# ---- a field of view ----------------------------------------------------------------------------------------------


def image(profile, seed=6):
    """A flat board over an image of 24 x 16 pixels at nine temperatures; profile over azimuth and elevation."""
    rng = np.random.default_rng(seed)
    step, v, u = grid(np.arange(9), np.arange(16), np.arange(0, 24))
    azimuth, elevation = 1.6 * (u - 11.5), -1.8 * (v - 7.5)
    temperature = np.array([-30.0, -10.0, 10.0, 25.0, 40.0, 60.0, 80.0, 30.0, 0.0])[step]
    light = 900.0 * np.exp(-((azimuth / 34.0) ** 4)) * np.exp(-((elevation / 21.0) ** 4))
    noise = np.sqrt(25.0 + light)
    shown = light * profile(azimuth, elevation)
    return columns_of({
        "step": step, "time_s": 1200.0 * step, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "tof_temperature_c": temperature + rng.normal(0.0, 0.1, step.size),
        "n_frames": np.full(step.size, 10.0), "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": shown + rng.normal(0.0, noise / np.sqrt(10.0)),
    })  # fmt: skip


def blurred(elevation_deg, sigma_deg):
    """Beam of an aged diffuser over the new one's: each ray spread by a Gaussian."""
    fine = np.arange(-90.0, 90.0, 0.02)
    beam = np.exp(-((fine / 21.0) ** 4))
    kernel = np.exp(-0.5 * (np.arange(-30.0, 30.01, 0.02) / sigma_deg) ** 2)
    wide = np.convolve(beam, kernel / kernel.sum(), mode="same")
    return np.interp(elevation_deg, fine, wide / beam)


def test_a_beam_spread_by_its_diffuser_is_no_pattern_of_rows():
    (found,) = diagnose(image(lambda az, el: blurred(el, 4.0)))[0].findings
    assert found.effect == "beam.profile_change"


# ---- one that hides another ---------------------------------------------------------------------------------------


def worn_and_stained(seed=8):
    """Twelve cycles of a laser that fades by a sixth, behind a window with a spot of two per mille."""
    rng = np.random.default_rng(seed)
    cycle, step, v, u = grid(np.arange(12), np.arange(4), np.arange(8), np.arange(8))
    light = 6000.0 * (1.0 + 0.3 * np.cos(0.4 * step)) * np.exp(-(((u - 3.5) / 6.9) ** 4))
    facet = np.cumsum(np.full(12, 0.015))[cycle] - 0.015
    spot = 0.0022 / (1.0 + np.exp(6.0 * (np.hypot((u - 2.0) / 1.43, (v - 5.0) / 1.43) - 1.0)))
    noise = 0.0034 * light
    return columns_of({
        "cycle": cycle, "step": step, "time_s": 1000.0 * step, "pixel_u": u, "pixel_v": v,
        "n_frames": np.full(u.size, 10.0), "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": light * (1.0 - facet) * (1.0 - spot) + rng.normal(0.0, noise / np.sqrt(10.0)),
    })  # fmt: skip


def test_a_faint_spot_is_seen_under_a_laser_that_fades_a_thousand_times_as_clearly():
    found = [f.effect for f in diagnose(worn_and_stained())[0].findings]
    assert found == ["laser.power_decay", "optics.window_contamination"]


# ---- pixels that see two boards, ranged along their centre's ray --------------------------------------------------

BOARDS_DEG = ((-14.0, -9.0, 0.18), (-5.0, 1.0, 0.5), (4.5, 9.5, 0.8))
PITCH_DEG = 0.94


def boards(bearing_deg):
    """Range and albedo along rays: three upright boards before a wall, seen from their axis."""
    place, white = 1.6 / np.cos(np.radians(bearing_deg)), np.full(bearing_deg.shape, 0.06)
    for first, last, albedo in BOARDS_DEG:
        on = (bearing_deg >= first) & (bearing_deg < last)
        place, white = np.where(on, 1.1 / np.cos(np.radians(bearing_deg)), place), np.where(on, albedo, white)
    return place, white


def over_a_pixel(middle_deg, filled=0.8, pulse_ns=3.0):
    """Light, and range by the centroid of what comes back from 41 rays, each a pulse of its own."""
    rays = middle_deg[:, None] + filled * PITCH_DEG * (np.arange(41) - 20) / 41
    place, white = boards(rays)
    time = np.arange(-10.0, 36.0, 0.2)
    wave = np.einsum(
        "nr,nrt->nt", white / place**2, np.exp(-0.5 * ((time - 2.0 * place[..., None] / LIGHT_M_NS) / pulse_ns) ** 2)
    )
    return (white / place**2).mean(axis=1), 0.5 * LIGHT_M_NS * (wave @ time) / wave.sum(axis=1)


def ranged_by_the_centre(seed=9):
    rng = np.random.default_rng(seed)
    step, stop, row, column = grid(np.arange(4), np.arange(9), np.arange(2), np.arange(30))
    angle, pixel_v = np.array([-33.0, -12.4, -7.9, -3.1, 0.6, 4.4, 9.1, 14.7, 31.0])[stop], np.array([9.0, 20.0])[row]
    azimuth = PITCH_DEG * (column - 14.5)
    bearing = azimuth + angle
    sights, again = np.unique(bearing, return_inverse=True)
    light, far = (x[again] for x in over_a_pixel(sights))
    place, white = boards(bearing)
    ends = [boards(bearing + side * 0.5 * PITCH_DEG)[1] for side in (-0.8, 0.8)]
    names = {0.06: "wall", 0.18: "grey", 0.5: "light", 0.8: "white"}
    counts = 4500.0 * light
    noise, blur = 10.0 + np.sqrt(0.2 * counts), 0.005 * (1.0 + 200.0 / counts)
    return columns_of(
        {
            "step": step, "set_temperature_c": np.array([-10.0, 25.0, 55.0, 85.0])[step],
            "time_s": 3600.0 * step + 14.0 * stop, "stage_angle_deg": angle, "pixel_u": column, "pixel_v": pixel_v,
            "azimuth_deg": azimuth, "elevation_deg": 0.33 * (pixel_v - 15.5), "true_range_m": place,
            "reflectance": white, "n_frames": np.full(step.size, 1.0),
            "sim_intensity_counts": counts, "sim_intensity_counts_std": noise,
            "sim_distance_m": place, "sim_distance_m_std": blur,
            "intensity_counts": counts + rng.normal(0.0, noise), "distance_m": far + rng.normal(0.0, blur),
        },
        surface=np.array([names[x] for x in white]),
        mixed=np.where((ends[0] != white) | (ends[1] != white), "true", "false"),
    )  # fmt: skip


def test_a_pixel_that_sees_two_boards_ranged_along_its_centre_mixes_them():
    (found,) = diagnose(ranged_by_the_centre())[0].findings
    assert found.effect == "target.edge_mixing"
    assert "mixed" in found.drivers
