"""Device settings: frozen values that a session holds and a device is given."""

import math
import unicodedata
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

from rona_core.devices.limits import choice, label_of_value, limited, number, require_limits, switch
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.robots import ROBOTS

HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode categories of what cannot be seen in a name
STRICT = {"extra": "forbid", "allow_inf_nan": False}  # how a web layer parses these classes

TrackerProfile = Literal["ideal", "polaris", "white035", "spectra", "vega"]
PointerKind = Literal["pointer6d", "pointer5d"]
Excitation = Literal["pulse", "chirp"]
PulseShape = Literal["resonant", "damped", "double", "ringing"]

# Tracked rigid bodies, by name. New ones come last: each draws its noise after those before it.
POINTERS: dict[str, str] = {"pointer6d": "6D pointer", "pointer5d": "5D pointer"}
TOOL_TITLES = {
    "toolmarker": "tool marker",
    **POINTERS,
    "basemarker": "base marker",
    "sonopointer": "SonoPointer",
    "headmarker": "head marker",
}
TOOLS = tuple(TOOL_TITLES)
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

    shift_mm: tuple[float, float, float] = number(
        (0.0, 0.0, 0.0), "Tracker shift", "mm", -500.0, 500.0, 1.0, hint="Along x, y, z of the base"
    )
    turn_deg: float = number(
        0.0, "Tracker rotation", "deg", -20.0, 20.0, 0.5, hint="About the vertical"
    )

    def __post_init__(self) -> None:
        require_limits(self)


FIRST_PLACE = TrackerPlace()


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Errors and faults of the optical tracker.

    ``docs/algorithms/virtual_world/virtual_tracker.md`` explains each.
    """

    __pydantic_config__: ClassVar = STRICT

    profile: TrackerProfile = choice(
        "polaris",
        "Tracker",
        {
            "polaris": "NDI Polaris (0.35 mm RMS)",
            "spectra": "NDI Polaris Spectra (0.25 mm RMS)",
            "vega": "NDI Polaris Vega (0.12 mm RMS)",
            "white035": "White noise 0.35 mm",
            "ideal": "Without noise",
        },
        "Optical tracker that is simulated, with its published noise",
    )
    rate_hz: float = number(
        60.0, "Rate", "Hz", 20.0, 60.0, 1.0, hint="Frames of the tracker in a second"
    )
    hidden_tools: tuple[str, ...] = limited((), enum=TOOLS)  # tools that are covered up
    stereo: bool = switch(True, "Stereo error model", "Error grows with the distance")
    depth_ratio: float = number(
        3.0, "Depth ratio", "", 1.0, 8.0, 0.5, hint="Ratio of depth error to lateral error"
    )
    occlusion: bool = switch(True, "Simulate occlusion", "Head, robot and hand hide markers")
    phantom_share: float = number(
        0.0, "Ghost solutions", "", 0.0, 0.2, 0.01, hint="5D tools seen reversed", percent=True
    )
    latency_ms: float | None = number(
        None,
        "Latency",
        "ms",
        0.0,
        200.0,
        1.0,
        hint="From measurement to arrival; null: of the profile",
    )
    drift_mm: float = number(
        0.0, "Warm-up drift", "mm", 0.0, 2.0, 0.1, hint="At switch-on; decays with time"
    )
    minutes_on: float = number(
        60.0, "Warm-up time", "min", 0.0, 600.0, 1.0, hint="From switch-on to the first capture"
    )
    dropped_share: float = number(
        0.0, "Frame loss", "", 0.0, 0.5, 0.01, hint="Share of lost frames", percent=True
    )
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

    force_n: float = number(3.0, "Contact force", "N", 0.5, 8.0, 0.5, hint="Along the tool axis")
    period_ms: float = number(
        16.0, "Control period", "ms", 1.0, 50.0, 1.0, hint="Time between two corrections"
    )
    delay_ms: float = number(
        32.0, "Robot delay", "ms", 0.0, 200.0, 1.0, hint="Dead time before the robot follows"
    )
    lag_ms: float = number(
        20.0, "Robot lag", "ms", 1.0, 200.0, 1.0, hint="Time constant with which the robot follows"
    )
    travel_mm: float = number(
        5.0, "Max. correction", "mm", 1.0, 10.0, 0.5, hint="Off the plan, either way"
    )
    approach_mm_per_s: float = number(
        2.0, "Approach speed", "mm/s", 0.2, 10.0, 0.2, hint="Speed towards the bone before contact"
    )
    monitor_n: float = number(
        10.0,
        "Soft force limit",
        "N",
        1.5,
        30.0,
        0.5,
        hint="The scan halts and the probe yields",
        above=("force_n", 1.0),
    )
    stop_n: float = number(
        20.0,
        "Hard force limit",
        "N",
        2.5,
        50.0,
        0.5,
        hint="The robot stops",
        above=("monitor_n", 1.0),
    )

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

    model: str = choice(
        "rx90",
        "Arm",
        {name: one.title for name, one in ROBOTS.items()},
        "Robot that holds the probe",
    )
    # systematic field, repeatability and orientation error
    errors: bool = switch(True, "Simulate robot error", "0.35 mm RMS over its workspace")
    scan_speed_mm_per_s: float = number(
        20.0, "Scan speed", "mm/s", 0.5, 100.0, 1.0, hint="Speed of the probe along the path"
    )
    base_shift_mm: tuple[float, float, float] = number(
        (0.0, 0.0, 0.0),
        "Base shift",
        "mm",
        -2000.0,
        2000.0,
        1.0,
        hint="From its default place, in x, y and z",
    )
    base_turn_deg: float = number(
        0.0, "Base rotation", "deg", -180.0, 180.0, 1.0, hint="About the vertical"
    )
    contact: ContactSettings | None = ContactSettings()  # None: driven by position alone
    latency_ms: float = number(
        8.0, "Latency", "ms", 0.0, 100.0, 1.0, hint="From reading joint angles to their arrival"
    )

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """Which ultrasound probe, what it sends and how noisy its receiver is.

    What is None is as the named probe has it.
    """

    __pydantic_config__: ClassVar = STRICT

    name: str = choice(
        "2.25MHz",
        "Probe",
        {name: one.title for name, one in PROBE_DATA.items()},
        "Ultrasound probe; the table below compares what each can measure",
    )
    excitation: Excitation = choice(
        "chirp",
        "Excitation",
        {"chirp": "Chirp", "pulse": "Pulse"},
        "Signal that is sent: a chirp is compressed afterwards, a pulse is not",
    )
    front_snr_db: float = number(
        50.0, "SNR", "dB", 0.0, 90.0, 1.0, hint="Front echo over in-band RMS noise of one shot"
    )
    shots: int = number(
        32, "Shots averaged", "", 1, 128, 1, hint="For an A-scan; 1000 in a second", before=1
    )
    pitch_mm: float = number(
        1.0, "Pitch", "mm", 0.2, 10.0, 0.1, hint="Distance between A-scans along the path"
    )
    # what a probe may be made of: the echo of its line comes before its record ends
    centre_mhz: float | None = number(
        None, "Centre frequency", "MHz", 0.5, 5.0, 0.05, hint="Higher resolves thinner bone"
    )
    bandwidth: float | None = number(
        None, "Relative bandwidth", "", 0.2, 0.9, 0.02, hint="At -6 dB, over the centre frequency"
    )
    aperture_mm: float | None = number(
        None, "Element diameter", "mm", 3.0, 20.0, 0.1, hint="Of the transducer element"
    )
    line_length_mm: float | None = number(
        None, "Delay line length", "mm", 8.0, 25.0, 0.5, hint="Length of the elastomer"
    )
    pulse_shape: PulseShape | None = choice(
        None,
        "Pulse",
        {"resonant": "Resonant", "damped": "Damped", "double": "Two lobes", "ringing": "Ringing"},
        "As measured on a block",
    )
    adc_bits: int | None = number(None, "ADC resolution", "bit", 6, 16, 1, hint="Of the receiver")
    gain_db: float = number(
        0.0,
        "Gain",
        "dB",
        -20.0,
        40.0,
        1.0,
        hint="0: a front echo fills half the scale of the receiver",
    )
    line_temperature_c: float = number(
        ROOM_C, "Line temperature", "°C", 10.0, 45.0, 1.0, hint="The line slows sound when warm"
    )

    def __post_init__(self) -> None:
        require_limits(self)

    @property
    def averaged_snr_db(self) -> float:
        """Front echo over the noise of an A-scan, whose shots have noise of their own each."""
        return self.front_snr_db + 10.0 * math.log10(self.shots)

    def of_probe(self, name: str) -> "ProbeSettings":
        """Return these settings of a probe of the catalogue; another one is as it is built."""
        if name == self.name:
            return self
        built = dict.fromkeys(("centre_mhz", "bandwidth", "aperture_mm", "line_length_mm"))
        return replace(self, name=name, pulse_shape=None, **built)


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """All device settings of a session."""

    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    robot: RobotSettings = field(default_factory=RobotSettings)
    probe: ProbeSettings = field(default_factory=ProbeSettings)
    pointer: PointerKind = choice(
        "pointer6d",
        "Pointer",
        POINTERS,
        "6D: rigid marker body with its full pose; 5D: markers along the shaft",
    )

    def titles(self) -> dict[str, str]:
        """Return what the devices are called, by "Robot", "Probe", "Tracker" and "Pointer"."""
        excitation = label_of_value(self.probe, "excitation").lower()
        return {
            "Robot": label_of_value(self.robot, "model"),
            "Probe": f"{label_of_value(self.probe, 'name')}, {excitation}",
            "Tracker": label_of_value(self.tracker, "profile"),
            "Pointer": label_of_value(self, "pointer"),
        }
