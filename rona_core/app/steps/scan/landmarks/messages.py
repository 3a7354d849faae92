"""Messages of the verification on landmarks."""

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import limited

MAX_REASON = 300  # characters


@message
class StartLandmarkCapture:
    """Hold the pointer on each landmark in turn; then verify.

    Landmarks are divots near the head that the robot's tip has touched: the robot knows them
    without the tracker.
    """

    dwell_s: float = within(0.3, 10.0, default=0.8)  # the pointer rests in each
    travel_s: float = within(0.3, 10.0, default=0.7)  # from one to the next


@message
class VerifyLandmarks:
    """Compare the landmarks by tracker and pointer with those of the robot, and judge.

    It fails where one is farther off than ``sigmas`` times what is predicted of its distance, or
    than ``limit_mm``.
    """

    sigmas: float = within(1.0, 10.0, default=3.0)
    limit_mm: float = within(0.1, 10.0, default=2.0)


@message
class OverrideLandmarks:
    """Let the robot scan although the verification failed or was not done; the log keeps why."""

    reason: str = limited(
        minLength=3,
        maxLength=MAX_REASON,
        pattern=r"^\s*\S[\s\S]+\S\s*$",
        rule=f"3 to {MAX_REASON} characters, blanks around them not counted",
    )
