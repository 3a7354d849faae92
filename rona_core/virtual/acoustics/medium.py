"""The layers of a simulated skull: ground truth, unknown to the detection of echoes."""

from dataclasses import dataclass, field

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.probe.materials import BRAIN, DIPLOE, GEL, TABLE, Material


@dataclass(frozen=True, slots=True)
class Medium:
    """A skull: gel, outer table, diploe, inner table, brain, and how blurred the diploe ends are.

    ``ramp_mm`` is the width over which table turns into diploe. A sharp step makes the
    table-diploe echo stronger than that of the inner boundary; real bone has 0.3 to 0.8 mm.
    Roughness is the rms deviation of a boundary from its smooth shape; ``speckle`` is the rms
    reflectivity of one 0.15 mm cell of diploe. ``MEDIA`` has them by name.
    """

    gel: Material = field(default=GEL)
    table: Material = field(default=TABLE)
    diploe: Material = field(default=DIPLOE)
    brain: Material = field(default=BRAIN)
    ramp_mm: float = 0.5
    outer_roughness_mm: float = 0.02
    inner_roughness_mm: float = 0.05
    speckle: float = 0.02
    local_speed_sd: float = 0.0  # relative rms of the speed of sound over the skull

    def __post_init__(self) -> None:
        values = (self.ramp_mm, self.outer_roughness_mm, self.inner_roughness_mm, self.speckle)
        if min(values) < 0:
            raise InvalidInputError("ramp, roughness and speckle must not be negative")
        if not 0.0 <= self.local_speed_sd <= 0.1:
            raise InvalidInputError("local_speed_sd must be 0 to 0.1")


# "sharp": the table ends at once, so its echo is louder than that of the inner boundary; "hard":
# 2.5 times the scatter on top, and rougher.
MEDIA = {
    "normal": Medium(),
    "sharp": Medium(ramp_mm=0.0),
    "hard": Medium(
        ramp_mm=0.0,
        outer_roughness_mm=0.03,
        inner_roughness_mm=0.08,
        speckle=0.05,
    ),
}
