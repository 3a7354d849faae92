"""Motion as URScript, the programs of Universal Robots: written, and read where it is plain.

Read are ``movej`` to joint angles (from rest to rest, as the manual documents it), ``servoj``,
``sleep``, and what RONA itself writes. Whatever else moves the arm, or may, is refused by its line.
"""

import re

import numpy as np

from rona_core.devices.robots import UNIVERSAL
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.trajectory.trajectory import TimedMotion
from rona_core.robot.verification.joint_motion import JointMotion

PERIOD_S = 0.008  # of servoj, on controllers of the CB series; those of the e series are faster
LOOKAHEAD_S, GAIN = 0.03, 1000  # the least smoothing that servoj has, so that it lags the least
SPEED_RAD_PER_S, ACCELERATION_RAD_PER_S2 = 0.3, 0.5  # of the move to where the motion begins
USUAL_SPEED, USUAL_ACCELERATION = 1.05, 1.4  # of movej without a speed, by the manual
RESTING_RAD = 2e-4  # in the first sample after a rest a joint turns by less
LONGEST_S = 3600.0


def write_urscript(certified: CertifiedMotion) -> bytes:
    """Return a motion as a program for the controller of a UR arm.

    The arm goes slowly to the first posture, then `servoj` receives the joint angles every 8 ms,
    linear between the samples, as they were certified. At pauses it waits for a confirmation.

    Raises:
        InvalidInputError: another robot, or a pause while it moves.
    """
    model, motion, name = certified.model.name, certified.motion, certified.name
    require_universal(model)
    lines = [*(f"# {line}" for line in (*certified.lines(), *HEAD)), f"def {name}():", *FOLLOW]
    lines.append(
        f"  movej({_joints(motion.qs_rad[0])}, a={ACCELERATION_RAD_PER_S2}, v={SPEED_RAD_PER_S})"
    )
    lines.append(f"  from_q = {_joints(motion.qs_rad[0])}")
    stops = {_row_at_rest(motion, pause.time_s): pause.words for pause in certified.pauses}
    gaps = np.diff(motion.times_s)
    for k in range(1, len(motion.times_s)):
        lines.append(f"  follow({_joints(motion.qs_rad[k])}, {gaps[k - 1]:.6f})")
        if k in stops:
            lines.append("  stopj(1.0)")
            lines.append(f'  popup("{stops[k]}", title="RONA", blocking=True)')
    return "\n".join((*lines, "  stopj(1.0)", "end", f"{name}()", "")).encode("ascii")


def require_universal(model: str) -> None:
    """Raise InvalidInputError where a robot has no URScript."""
    if model not in UNIVERSAL:
        raise InvalidInputError(
            f"URScript is for arms of Universal Robots ({', '.join(UNIVERSAL)}), this is the "
            f"{model}: take the table of joint angles"
        )


HEAD = (
    "Joint angles in rad, base to wrist 3, zero as in the description of the maker; for the model",
    "of the arm and not for its calibration. CHECK IT AT REDUCED SPEED. The program does not start",
    "the spindle. servoj lags behind its set point; the certificate holds for commanded angles.",
)
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


def _joints(q_rad: Floats) -> str:
    return "[" + ", ".join(f"{q:.9f}" for q in q_rad) + "]"


def _row_at_rest(motion: TimedMotion, time_s: float) -> int:
    """Return the sample of a pause; beside it the motion must hardly move."""
    row = int(np.argmin(np.abs(motion.times_s - time_s)))
    near = motion.qs_rad[max(0, row - 1) : row + 2]
    if np.abs(np.diff(near, axis=0)).max(initial=0.0) > RESTING_RAD:
        raise InvalidInputError(f"the motion does not stand still at {time_s:.2f} s")
    return row


CALL = re.compile(r"(\w+)\((.*)\)$")
ASSIGNED = re.compile(r"(?:global\s+|local\s+)?(\w+)\s*=\s*(\[.*\])$")
STILL = ("stopj", "popup", "textmsg", "sync", "set_tcp", "set_payload")  # at rest they move nothing
PLAIN = re.compile(r"(def \w+\(\):|end|\w+\(\))$")  # a program, its end, and its call
ANGLES = 6


def read_urscript(name: str, text: str) -> JointMotion:
    """Read a program of plain moves of the joints; it begins where its first move ends.

    Raises:
        InvalidInputError: a line that is not read, or no motion; it says which line.
    """
    program = _Program(name)
    own = [line.strip() for line in FOLLOW]
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    at = 0
    while at < len(lines):
        if lines[at : at + len(own)] == own:
            program.follows = True
            at += len(own)
            continue
        if lines[at]:
            program.line(lines[at], f"{name}, line {at + 1}")
        at += 1
    if len(program.times) < 2:
        raise InvalidInputError(
            f"{name} moves nothing: expected movej or servoj to joint angles, twice at least"
        )
    remark = "the arm stands at the first joint angles of the program when it begins"
    return JointMotion(np.array(program.times), np.array(program.qs), remarks=(remark,))


class _Program:
    """What a program has moved so far."""

    def __init__(self, name: str) -> None:
        self.name, self.follows = name, False
        self.times: list[float] = []
        self.qs: list[Floats] = []
        self._known: dict[str, Floats] = {}

    def line(self, text: str, where: str) -> None:
        """Carry out a line.

        Raises:
            InvalidInputError: it is not read.
        """
        if assigned := ASSIGNED.match(text):
            self._known[assigned[1]] = self._angles(assigned[2], where)
            return
        call = CALL.match(text)
        if PLAIN.match(text) or (call and call[1] in STILL):
            return
        places, named = _arguments(call[2]) if call else ([], {})
        if call and call[1] == "sleep" and len(places) == 1:
            self._stay(_number(places[0], where))
        elif call and call[1] == "follow" and self.follows and len(places) == 2:
            self._go(self._angles(places[0], where), _number(places[1], where))
        elif call and call[1] == "servoj" and places:
            self._go(self._angles(places[0], where), _number(named.get("t", "0.008"), where))
        elif call and call[1] == "movej" and places:
            self._movej(places, named, where)
        else:
            raise InvalidInputError(
                f"{where}: {text[:40]!r} is not read: expected movej, servoj or sleep with "
                "numbers, without loops, conditions, poses or linear moves"
            )

    def _go(self, q: Floats, time_s: float) -> None:
        self.times.append(self.times[-1] + time_s if self.times else 0.0)
        self.qs.append(q)

    def _stay(self, time_s: float) -> None:
        if self.qs and time_s > 0.0:
            self._go(self.qs[-1], time_s)

    def _movej(self, places: list[str], named: dict[str, str], where: str) -> None:
        """Move all joints together, the slowest of them with constant acceleration up to a speed.

        With ``t`` that is how long it takes, and acceleration and speed count no more.
        """
        given = dict(zip(("q", "a", "v", "t", "r"), places, strict=False)) | named
        radius, time_s = (_number(given.get(key, "0"), where) for key in "rt")
        if radius > 0.0:
            raise InvalidInputError(
                f"{where}: a move with a blend radius (r) is not read: what the controller drives "
                "there is not documented"
            )
        q = self._angles(given["q"], where)
        if not self.qs:
            self._go(q, 0.0)
            return
        most = float(np.abs(q - self.qs[-1]).max())
        if most == 0.0:
            return
        acceleration = _number(given.get("a", str(USUAL_ACCELERATION)), where)
        speed = _number(given.get("v", str(USUAL_SPEED)), where)
        if min(acceleration, speed) <= 0.0:
            raise InvalidInputError(f"{where}: speed and acceleration must be positive")
        if time_s > 0.0:  # half of it to gain speed, half to lose it
            acceleration, speed = 4.0 * most / time_s**2, 2.0 * most / time_s
        gain_s = min(speed / acceleration, np.sqrt(most / acceleration))
        top = acceleration * gain_s
        whole_s = most / top + gain_s
        if whole_s > LONGEST_S:
            raise InvalidInputError(f"{where}: a move of {whole_s:.0f} s can hardly be meant")
        start_s, start = self.times[-1], self.qs[-1]
        n = max(2, int(np.ceil(whole_s / PERIOD_S)))
        for k in range(1, n + 1):
            u = whole_s * k / n
            gained = 0.5 * acceleration * min(u, gain_s) ** 2
            even = top * max(0.0, min(u, whole_s - gain_s) - gain_s)
            left = max(0.0, u - (whole_s - gain_s))
            lost = top * left - 0.5 * acceleration * left**2
            self.times.append(start_s + u)
            self.qs.append(start + (gained + even + lost) / most * (q - start))

    def _angles(self, text: str, where: str) -> Floats:
        if text in self._known:
            return self._known[text]
        cells = text[1:-1].split(",") if text.startswith("[") and text.endswith("]") else []
        if len(cells) != ANGLES:
            raise InvalidInputError(f"{where}: expected six joint angles in rad, got {text[:60]!r}")
        return np.array([_number(cell, where) for cell in cells])


def _arguments(text: str) -> tuple[list[str], dict[str, str]]:
    """Return the arguments of a call: those by place, and those by name."""
    places: list[str] = []
    named: dict[str, str] = {}
    for part in re.findall(r"(?:\[[^\]]*\]|[^,\[])+", text):
        key, equals, value = part.strip().partition("=")
        if equals:
            named[key.strip()] = value.strip()
        else:
            places.append(key)
    return places, named


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InvalidInputError(f"{where}: expected a number, got {text.strip()[:40]!r}")
    return value
