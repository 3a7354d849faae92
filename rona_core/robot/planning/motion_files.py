"""Files of a certified motion for a robot's controller: table of joint angles, URScript."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.robots import UNIVERSAL
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.trajectory.trajectory import TimedMotion

PERIOD_S = 0.008  # of servoj, on controllers of the CB series; those of the e series are faster
LOOKAHEAD_S, GAIN = 0.03, 1000  # the least smoothing that servoj has, so that it lags the least
SPEED_RAD_PER_S, ACCELERATION_RAD_PER_S2 = 0.3, 0.5  # of the move to where the motion begins
RESTING_RAD = 2e-4  # in the first sample after a rest a joint turns by less
COLUMNS = "time_s," + ",".join(f"q{joint}_rad" for joint in range(1, 7))


@dataclass(frozen=True, slots=True)
class Pause:
    """A time at which the motion stands still and waits for a confirmation."""

    time_s: float
    words: str  # what is to be done, plain letters


def joints_csv(motion: TimedMotion, columns: Mapping[str, Sequence[object]] | None = None) -> str:
    """Return a motion as a table: time, joint angles (linear in between), and further columns.

    Raises:
        InvalidInputError: a column that is not as long as the motion.
    """
    further = columns or {}
    n = len(motion.times_s)
    for name, values in further.items():
        require(len(values) == n, f"column {name} must have {n} values, not {len(values)}")
    rows = [",".join((COLUMNS, *further))]
    for k in range(n):
        numbers = [f"{motion.times_s[k]:.3f}", *(f"{q:.7f}" for q in motion.qs_rad[k])]
        rows.append(",".join((*numbers, *(str(values[k]) for values in further.values()))))
    return "\n".join(rows) + "\n"


def urscript(
    model: str, motion: TimedMotion, name: str, digest: str, pauses: Sequence[Pause] = ()
) -> str:
    """Return a motion as a program for the controller of a UR arm.

    The arm goes slowly to the first posture, then `servoj` receives the joint angles every 8 ms,
    linear between the samples, as they were certified. At pauses it waits for a confirmation.

    Args:
        model: Name of the robot.
        motion: Joint angles in time.
        name: Of the program, letters and underscores.
        digest: Of the certificate.
        pauses: Where it waits; at each the motion must stand still.

    Raises:
        InvalidInputError: another robot, or a pause while it moves.
    """
    if model not in UNIVERSAL:
        raise InvalidInputError(
            f"URScript is for arms of Universal Robots ({', '.join(UNIVERSAL)}), this is the "
            f"{model}: take the table of joint angles"
        )
    lines = [*_header(model, motion, digest), f"def {name}():", *FOLLOW]
    lines.append(
        f"  movej({_joints(motion.qs_rad[0])}, a={ACCELERATION_RAD_PER_S2}, v={SPEED_RAD_PER_S})"
    )
    lines.append(f"  from_q = {_joints(motion.qs_rad[0])}")
    stops = {_row_at_rest(motion, pause.time_s): pause.words for pause in pauses}
    gaps = np.diff(motion.times_s)
    for k in range(1, len(motion.times_s)):
        lines.append(f"  follow({_joints(motion.qs_rad[k])}, {gaps[k - 1]:.3f})")
        if k in stops:
            lines.append("  stopj(1.0)")
            lines.append(f'  popup("{stops[k]}", title="RONA", blocking=True)')
    return "\n".join((*lines, "  stopj(1.0)", "end", f"{name}()", ""))


# Joint angles are followed evenly, in steps of at most a period.
FOLLOW = (
    "  global from_q = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
    "  def follow(to_q, time_s):",
    f"    steps = ceil(time_s / {PERIOD_S} - 0.001)",
    "    i = 1",
    "    while i <= steps:",
    "      s = 1.0 * i / steps",
    "      q = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
    "      j = 0",
    "      while j < 6:",
    "        q[j] = from_q[j] + s * (to_q[j] - from_q[j])",
    "        j = j + 1",
    "      end",
    f"      servoj(q, t=time_s / steps, lookahead_time={LOOKAHEAD_S}, gain={GAIN})",
    "      i = i + 1",
    "    end",
    "    from_q = to_q",
    "  end",
)


def _header(model: str, motion: TimedMotion, digest: str) -> tuple[str, ...]:
    last_s = float(motion.times_s[-1])
    return (
        f"# Motion of a {model}, planned and certified by RONA; not a medical device.",
        "# Joint angles in rad, base to wrist 3, zero as in the description of the maker; times",
        f"# in s, {last_s:.2f} s in all, for the model of the arm and not for its calibration.",
        "# CHECK IT AT REDUCED SPEED, without a burr and without a patient, before it is used.",
        "# The program does not start the spindle. servoj lags behind its set point; the",
        "# certificate holds for the commanded angles, with this digest:",
        f"# {digest}",
    )


def _joints(q_rad: Floats) -> str:
    return "[" + ", ".join(f"{q:.6f}" for q in q_rad) + "]"


def _row_at_rest(motion: TimedMotion, time_s: float) -> int:
    """Return the sample of a pause; beside it the motion must hardly move."""
    row = int(np.argmin(np.abs(motion.times_s - time_s)))
    near = motion.qs_rad[max(0, row - 1) : row + 2]
    if np.abs(np.diff(near, axis=0)).max(initial=0.0) > RESTING_RAD:
        raise InvalidInputError(f"the motion does not stand still at {time_s:.2f} s")
    return row
