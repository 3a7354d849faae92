"""Device settings: frozen values that a session holds and a device is given."""

import unicodedata
from dataclasses import dataclass, field
from typing import ClassVar, Literal, get_args

from rona_core.devices.limits import limited, number, require_limits
from rona_core.devices.limits import require as require  # the same for other settings
from rona_core.devices.limits import require_within as require_within
from rona_core.devices.probes import PROBE_DATA

HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode categories of what cannot be seen in a name
STRICT = {"extra": "forbid", "allow_inf_nan": False}  # how a web layer parses these classes

TrackerProfile = Literal["ideal", "polaris", "white035", "spectra", "vega"]
PointerKind = Literal["pointer6d", "pointer5d"]
Excitation = Literal["pulse", "chirp"]
PulseShape = Literal["resonant", "damped", "double", "ringing"]

# Tracked rigid bodies, by name. New ones come last: each draws its noise after those before it.
TOOLS = ("toolmarker", "pointer6d", "pointer5d", "basemarker", "sonopointer", "headmarker")
SONO = "sonopointer"  # the ultrasound probe with a marker plate, held in the hand
LATENCY_MS = {"vega": 14.0}  # of profiles that state one; the others deliver at once

ROOM_C = 22.0  # temperature at which the delay lines are specified


def hidden_characters(text: str) -> set[str]:
    """Return the characters of a name that cannot be seen, or that turn the order of others round.

    Control characters, ends of lines, halves of characters and the formats of Unicode, among them
    those of bidirectional text; but the two joiners, which Persian and Hindi are written with.
    """
    return {c for c in text if unicodedata.category(c) in HIDDEN and c not in "\u200c\u200d"}


@dataclass(frozen=True, slots=True)
class TrackerPlace:
    """Where the tracker stands: shifted from its first place, and turned about its vertical."""

    __pydantic_config__: ClassVar = STRICT

    shift_mm: tuple[float, float, float] = number(  # along the axes of ``base``
        (0.0, 0.0, 0.0), "Tracker shift", "mm", -500.0, 500.0, 1.0
    )
    turn_deg: float = number(0.0, "Tracker rotation", "deg", -20.0, 20.0, 0.5)

    def __post_init__(self) -> None:
        require_limits(self)


FIRST_PLACE = TrackerPlace()


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Errors and faults of the optical tracker.

    ``docs/algorithms/virtual_world/virtual_tracker.md`` explains each.
    """

    __pydantic_config__: ClassVar = STRICT

    profile: TrackerProfile = "polaris"
    rate_hz: float = number(60.0, "Rate", "Hz", 20.0, 60.0, 1.0)
    hidden_tools: tuple[str, ...] = limited((), enum=TOOLS)  # tools that are covered up
    stereo: bool = True  # errors grow with the distance, as those of two cameras do
    # error in depth over error in either lateral direction
    depth_ratio: float = number(3.0, "Depth ratio", "", 1.0, 8.0, 0.5)
    occlusion: bool = True  # head, robot and hand can hide single markers
    # of the frames of a 5D tool: two markers taken for each other
    phantom_share: float = number(0.0, "Ghost solutions", "", 0.0, 0.2, 0.01)
    # from measurement to arrival; None: as the profile has it
    latency_ms: float | None = number(None, "Latency", "ms", 0.0, 200.0, 1.0)
    # by which a cold tracker is off; it decays while it warms up
    drift_mm: float = number(0.0, "Warm-up drift", "mm", 0.0, 2.0, 0.1)
    # since it was switched on, when the first capture begins
    minutes_on: float = number(60.0, "Warm-up time", "min", 0.0, 600.0, 1.0)
    # of the frames, which never arrive
    dropped_share: float = number(0.0, "Frame loss", "", 0.0, 0.5, 0.01)
    place: TrackerPlace = FIRST_PLACE  # it may be moved between captures

    def __post_init__(self) -> None:
        require_limits(self)

    @property
    def latency_s(self) -> float:
        """How much later than it was measured a frame arrives."""
        stated = LATENCY_MS.get(self.profile, 0.0) if self.latency_ms is None else self.latency_ms
        return stated / 1000.0


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """Force control of the probe; ``docs/algorithms/robot/force_control.md`` explains each."""

    __pydantic_config__: ClassVar = STRICT

    # set point, along the tool axis
    force_n: float = number(3.0, "Contact force", "N", 0.5, 8.0, 0.5)
    period_ms: float = number(16.0, "Control period", "ms", 1.0, 50.0, 1.0)  # of the loop
    # from a correction that is sent to the robot beginning it
    delay_ms: float = number(32.0, "Robot delay", "ms", 0.0, 200.0, 1.0)
    # time constant with which the robot then follows
    lag_ms: float = number(20.0, "Robot lag", "ms", 1.0, 200.0, 1.0)
    # the correction may go this far either way from the certified motion
    travel_mm: float = number(5.0, "Max. correction", "mm", 1.0, 10.0, 0.5)
    # closing speed until the probe is pressed on
    approach_mm_per_s: float = number(2.0, "Approach speed", "mm/s", 0.2, 10.0, 0.2)
    # above it the scan halts and the probe yields
    monitor_n: float = number(10.0, "Soft force limit", "N", 1.5, 30.0, 0.5, above=("force_n", 1.0))
    # above it everything stops
    stop_n: float = number(20.0, "Hard force limit", "N", 2.5, 50.0, 0.5, above=("monitor_n", 1.0))

    def __post_init__(self) -> None:
        require_limits(self)

    @property
    def period_s(self) -> float:
        """Time between two steps of the control loop."""
        return self.period_ms / 1000.0


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """Which robot, how exact, how fast, where its base stands, and how it presses the probe on."""

    __pydantic_config__: ClassVar = STRICT

    model: str = "rx90"
    errors: bool = True  # systematic field, repeatability and orientation error
    scan_speed_mm_per_s: float = number(20.0, "Scan speed", "mm/s", 0.5, 100.0, 1.0)
    # from the default place
    base_shift_mm: tuple[float, float, float] = number(
        (0.0, 0.0, 0.0), "Base shift", "mm", -2000.0, 2000.0, 1.0
    )
    # about the vertical
    base_turn_deg: float = number(0.0, "Base rotation", "deg", -180.0, 180.0, 1.0)
    contact: ContactSettings | None = ContactSettings()  # None: driven by position alone
    # by which joint angles arrive later than they were read
    latency_ms: float = number(8.0, "Latency", "ms", 0.0, 100.0, 1.0)

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """Which ultrasound probe, what it sends and how noisy its receiver is.

    What is None is as the named probe has it.
    """

    __pydantic_config__: ClassVar = STRICT

    name: str = limited("2.25MHz", enum=tuple(PROBE_DATA))
    excitation: Excitation = "chirp"
    # front echo peak over in-band noise rms, perpendicular contact
    front_snr_db: float = number(50.0, "SNR", "dB", 0.0, 90.0, 1.0)
    # distance between A-scans along the path
    pitch_mm: float = number(1.0, "Pitch", "mm", 0.2, 10.0, 0.1)
    # what a probe may be made of: the echo of its line comes before its record ends
    centre_mhz: float | None = number(None, "Centre frequency", "MHz", 0.5, 5.0, 0.05)
    # full width at -6 dB over the centre frequency
    bandwidth: float | None = number(None, "Relative bandwidth", "", 0.2, 0.9, 0.02)
    # diameter of the crystal
    aperture_mm: float | None = number(None, "Element diameter", "mm", 3.0, 20.0, 0.1)
    line_length_mm: float | None = number(None, "Delay line length", "mm", 8.0, 25.0, 0.5)
    pulse_shape: PulseShape | None = limited(None, enum=get_args(PulseShape))
    adc_bits: int | None = number(None, "ADC resolution", "bit", 6, 16, 1)
    # of the receiver, over the one at which a front echo fills half its scale
    gain_db: float = number(0.0, "Gain", "dB", -20.0, 40.0, 1.0)
    # that the line really has; its echo is timed for ROOM_C
    line_temperature_c: float = number(ROOM_C, "Line temperature", "°C", 10.0, 45.0, 1.0)

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """All device settings of a session."""

    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    robot: RobotSettings = field(default_factory=RobotSettings)
    probe: ProbeSettings = field(default_factory=ProbeSettings)
    pointer: PointerKind = "pointer6d"
