"""Messages of the verification on landmarks."""

from rona_core.app.messages.message import message
from rona_core.devices.limits import limited, number

MAX_REASON = 300  # characters


@message
class StartLandmarkCapture:
    """Hold the pointer on each landmark in turn; then verify.

    Landmarks are divots near the head that the robot's tip has touched: the robot knows them
    without the tracker.
    """

    dwell_s: float = number(
        0.8, "Rest", "s", 0.3, 10.0, 0.1, hint="Of the pointer in each landmark"
    )
    travel_s: float = number(
        0.7, "Travel", "s", 0.3, 10.0, 0.1, hint="From one landmark to the next"
    )


@message
class VerifyLandmarks:
    """Compare the landmarks by tracker and pointer with those of the robot, and judge.

    It fails where one is farther off than ``sigmas`` times what is predicted of its distance, or
    than ``limit_mm``.
    """

    sigmas: float = number(
        3.0, "Limit in sigmas", "", 1.0, 10.0, 0.5, hint="Of the predicted distance"
    )
    limit_mm: float = number(
        2.0, "Limit", "mm", 0.1, 10.0, 0.1, hint="Of the distance of a landmark"
    )


@message
class OverrideLandmarks:
    """Let the robot scan although the verification failed or was not done; the log keeps why."""

    reason: str = limited(
        minLength=3,
        maxLength=MAX_REASON,
        pattern=r"^\s*\S[\s\S]+\S\s*$",
        rule=f"3 to {MAX_REASON} characters, blanks around them not counted",
    )
