"""Device settings: frozen values that a session holds and a device is given."""

import unicodedata
from dataclasses import dataclass, field
from typing import ClassVar, Literal, get_args

from rona_core.errors import InvalidInputError

HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode categories of what cannot be seen in a name
STRICT = {"extra": "forbid", "allow_inf_nan": False}  # how a web layer parses these classes

TrackerProfile = Literal["ideal", "polaris", "white035", "spectra", "vega"]
PointerKind = Literal["pointer6d", "pointer5d"]
ProbeName = Literal["2.25MHz", "1MHz"]
Excitation = Literal["pulse", "chirp"]
PulseShape = Literal["resonant", "damped", "double", "ringing"]

# Tracked rigid bodies, by name. New ones come last: each draws its noise after those before it.
TOOLS = ("toolmarker", "pointer6d", "pointer5d", "basemarker", "sonopointer", "headmarker")
SONO = "sonopointer"  # the ultrasound probe with a marker plate, held in the hand
TRACKER_RATES_HZ = (20.0, 60.0)  # lowest and highest
LATENCY_MS = {"vega": 14.0}  # of profiles that state one; the others deliver at once

ROOM_C = 22.0  # temperature at which the delay lines are specified
PROBE_LIMITS = {  # what a probe may be made of: the echo of its line comes before its record ends
    "centre_mhz": (0.5, 5.0),
    "bandwidth": (0.2, 0.9),
    "aperture_mm": (3.0, 20.0),
    "line_length_mm": (8.0, 25.0),
    "adc_bits": (6, 16),
    "gain_db": (-20.0, 40.0),
    "line_temperature_c": (10.0, 45.0),
}


def require(condition: bool, message: str) -> None:
    """Raise InvalidInputError with ``message`` unless ``condition`` holds."""
    if not condition:
        raise InvalidInputError(message)


def hidden_characters(text: str) -> set[str]:
    """Return the characters of a name that cannot be seen, or that turn the order of others round.

    Control characters, ends of lines, halves of characters and the formats of Unicode, among them
    those of bidirectional text; but the two joiners, which Persian and Hindi are written with.
    """
    return {c for c in text if unicodedata.category(c) in HIDDEN and c not in "\u200c\u200d"}


def require_within(name: str, value: float, low: float, high: float) -> None:
    """Raise InvalidInputError unless ``value`` lies between ``low`` and ``high``, both allowed."""
    require(low <= value <= high, f"{name} must be {low:g} to {high:g}, not {value:g}")


@dataclass(frozen=True, slots=True)
class TrackerPlace:
    """Where the tracker stands: shifted from its first place, and turned about its vertical."""

    __pydantic_config__: ClassVar = STRICT

    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # along the axes of ``base``
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        require(
            all(abs(v) <= 500.0 for v in self.shift_mm),
            f"shift_mm must stay within 500 mm, not {self.shift_mm}",
        )
        require_within("turn_deg", self.turn_deg, -20.0, 20.0)


FIRST_PLACE = TrackerPlace()


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Errors and faults of the optical tracker.

    ``docs/algorithms/virtual_world/virtual_tracker.md`` explains each.
    """

    __pydantic_config__: ClassVar = STRICT

    profile: TrackerProfile = "polaris"
    rate_hz: float = 60.0
    hidden_tools: tuple[str, ...] = ()  # tools that are covered up, see TOOLS
    stereo: bool = True  # errors grow with the distance, as those of two cameras do
    depth_ratio: float = 3.0  # error in depth over error in either lateral direction
    occlusion: bool = True  # head, robot and hand can hide single markers
    phantom_share: float = 0.0  # of the frames of a 5D tool: two markers taken for each other
    latency_ms: float | None = None  # from measurement to arrival; None: as the profile has it
    drift_mm: float = 0.0  # by which a cold tracker is off; it decays while it warms up
    minutes_on: float = 60.0  # since it was switched on, when the first capture begins
    dropped_share: float = 0.0  # of the frames, which never arrive
    place: TrackerPlace = FIRST_PLACE  # somebody may move it between captures

    def __post_init__(self) -> None:
        require_within("rate_hz", self.rate_hz, *TRACKER_RATES_HZ)
        for tool in self.hidden_tools:
            require(tool in TOOLS, f"tool must be one of {', '.join(TOOLS)}, not {tool!r}")
        require_within("depth_ratio", self.depth_ratio, 1.0, 8.0)
        require_within("phantom_share", self.phantom_share, 0.0, 0.2)
        if self.latency_ms is not None:
            require_within("latency_ms", self.latency_ms, 0.0, 200.0)
        require_within("drift_mm", self.drift_mm, 0.0, 2.0)
        require_within("minutes_on", self.minutes_on, 0.0, 600.0)
        require_within("dropped_share", self.dropped_share, 0.0, 0.5)

    @property
    def latency_s(self) -> float:
        """How much later than it was measured a frame arrives."""
        stated = LATENCY_MS.get(self.profile, 0.0) if self.latency_ms is None else self.latency_ms
        return stated / 1000.0


ROBOTS = {"rx90": "Stäubli RX90", "ur5": "UR5", "ur10": "UR10"}  # what people call them


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """Force control of the probe; ``docs/algorithms/robot/force_control.md`` explains each."""

    __pydantic_config__: ClassVar = STRICT

    force_n: float = 3.0  # set point, along the tool axis
    period_ms: float = 16.0  # of the control loop
    delay_ms: float = 32.0  # from a correction that is sent to the robot beginning it
    lag_ms: float = 20.0  # time constant with which the robot then follows
    travel_mm: float = 5.0  # the correction may go this far either way from the certified motion
    approach_mm_per_s: float = 2.0  # closing speed until the probe is pressed on
    monitor_n: float = 10.0  # above it the scan halts and the probe yields
    stop_n: float = 20.0  # above it everything stops

    def __post_init__(self) -> None:
        require_within("force_n", self.force_n, 0.5, 8.0)
        require_within("period_ms", self.period_ms, 1.0, 50.0)
        require_within("delay_ms", self.delay_ms, 0.0, 200.0)
        require_within("lag_ms", self.lag_ms, 1.0, 200.0)
        require_within("travel_mm", self.travel_mm, 1.0, 10.0)
        require_within("approach_mm_per_s", self.approach_mm_per_s, 0.2, 10.0)
        require_within("monitor_n", self.monitor_n, self.force_n + 1.0, 30.0)
        require_within("stop_n", self.stop_n, self.monitor_n + 1.0, 50.0)

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
    scan_speed_mm_per_s: float = 20.0
    base_shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # from the default place
    base_turn_deg: float = 0.0  # about the vertical
    contact: ContactSettings | None = ContactSettings()  # None: driven by position alone
    latency_ms: float = 8.0  # by which joint angles arrive later than they were read

    def __post_init__(self) -> None:
        require_within("latency_ms", self.latency_ms, 0.0, 100.0)
        require_within("scan_speed_mm_per_s", self.scan_speed_mm_per_s, 0.5, 100.0)
        require(
            all(abs(v) <= 2000.0 for v in self.base_shift_mm),
            f"base_shift_mm must stay within 2000 mm, not {self.base_shift_mm}",
        )
        require_within("base_turn_deg", self.base_turn_deg, -180.0, 180.0)


@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """Which ultrasound probe, what it sends and how noisy its receiver is.

    What is None is as the named probe has it.
    """

    __pydantic_config__: ClassVar = STRICT

    name: ProbeName = "2.25MHz"
    excitation: Excitation = "chirp"
    front_snr_db: float = 50.0  # front echo peak over in-band noise rms, perpendicular contact
    pitch_mm: float = 1.0  # distance between A-scans along the path
    centre_mhz: float | None = None
    bandwidth: float | None = None  # full width at -6 dB over the centre frequency
    aperture_mm: float | None = None  # diameter of the crystal
    line_length_mm: float | None = None
    pulse_shape: PulseShape | None = None
    adc_bits: int | None = None
    gain_db: float = 0.0  # of the receiver, over the one at which a front echo fills half its scale
    line_temperature_c: float = ROOM_C  # that the line really has; its echo is timed for ROOM_C

    def __post_init__(self) -> None:
        require_within("front_snr_db", self.front_snr_db, 0.0, 90.0)
        require_within("pitch_mm", self.pitch_mm, 0.2, 10.0)
        for name, (low, high) in PROBE_LIMITS.items():
            value = getattr(self, name)
            if value is not None:
                require_within(name, value, low, high)
        if self.pulse_shape is not None:
            shapes = get_args(PulseShape)
            require(
                self.pulse_shape in shapes,
                f"pulse_shape must be one of {', '.join(shapes)}, not {self.pulse_shape!r}",
            )


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """All device settings of a session."""

    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    robot: RobotSettings = field(default_factory=RobotSettings)
    probe: ProbeSettings = field(default_factory=ProbeSettings)
    pointer: PointerKind = "pointer6d"
