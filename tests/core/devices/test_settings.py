import numpy as np
import pytest

from rona_core.devices.limits import require
from rona_core.devices.settings import (
    TOOLS,
    DeviceSettings,
    ProbeSettings,
    RobotSettings,
    TrackerSettings,
)
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError


def test_the_defaults_are_valid_and_equal():
    assert DeviceSettings() == DeviceSettings()
    assert DeviceSettings().tracker == TrackerSettings()


@pytest.mark.parametrize(
    ("kind", "field", "good", "bad"),
    [
        (TrackerSettings, "rate_hz", (20.0, 60.0), (19.9, 60.1, np.nan)),
        (TrackerSettings, "hidden_tools", ((), TOOLS), (("hammer",),)),
        (TrackerSettings, "depth_ratio", (1.0, 8.0), (0.9, 8.1, np.nan)),
        (TrackerSettings, "phantom_share", (0.0, 0.2), (-0.01, 0.21, np.nan)),
        (TrackerSettings, "latency_ms", (None, 0.0, 200.0), (-1.0, 201.0, np.nan)),
        (TrackerSettings, "drift_mm", (0.0, 2.0), (-0.1, 2.1, np.nan)),
        (TrackerSettings, "minutes_on", (0.0, 600.0), (-1.0, 601.0, np.nan)),
        (TrackerSettings, "dropped_share", (0.0, 0.5), (-0.1, 0.6, np.nan)),
        (RobotSettings, "scan_speed_mm_per_s", (0.5, 100.0), (0.4, 101.0, np.nan)),
        (RobotSettings, "base_shift_mm", ((2000.0, 0.0, -2000.0),), ((0.0, 2001.0, 0.0),)),
        (RobotSettings, "base_turn_deg", (-180.0, 180.0), (181.0, np.nan)),
        (ProbeSettings, "front_snr_db", (0.0, 90.0), (-1.0, 91.0, np.nan)),
        (ProbeSettings, "pitch_mm", (0.2, 10.0), (0.1, 11.0, np.nan)),
    ],
)
def test_settings_accept_their_range_and_name_what_is_outside(kind, field, good, bad):
    for value in good:
        assert getattr(kind(**{field: value}), field) == value
    for value in bad:
        with pytest.raises(InvalidInputError, match=field.removeprefix("hidden_").rstrip("s")):
            kind(**{field: value})


def test_require_raises_only_when_it_must():
    require(True, "fine")
    with pytest.raises(InvalidInputError, match="too far"):
        require(False, "too far")


def test_every_tool_has_markers_that_fix_its_degrees_of_freedom():
    assert set(GEOMETRIES) == set(TOOLS)
    for name, geometry in GEOMETRIES.items():
        spread = np.linalg.svd(
            geometry.positions_marker - geometry.positions_marker.mean(axis=0), compute_uv=False
        )
        assert geometry.tool == name
        assert (spread > 1.0).sum() == (2 if geometry.dof == 6 else 1)
        if geometry.dof == 5:
            np.testing.assert_array_equal(geometry.nominal_tip_marker[:2], 0.0)
