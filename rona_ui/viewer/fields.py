"""Fields of one browser and their hints: typed text counts once Enter is pressed or it is left.

viser reports every key. The page keeps what is being typed to itself (``static/fields.js``) and
sends the text as it stands when it is finished. It is read here, held against the limits of its
field and written into it, or refused; then the field shows what it held before, and why stands
below it. Beside each control its hint is kept for the page, which shows it where viser does not: on
buttons and on labels (``static/docks.js``).
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rona_core.errors import InvalidInputError
from rona_ui.viewer.bindings import Event, escape
from rona_ui.viewer.gateway import uuid_of

HINTS = {
    # the procedure
    "Start": "Starts the active step with the fields below",
    "Cancel": "Ends the running job; what was there before is kept",
    "Continue": "Starts the next stage of the procedure, in its step",
    "Skip": "Passes over this stage: the procedure is complete without it",
    "Remedy": "Mends what the note above says",
    "Next step": "Opens the next step of the procedure",
    "Retract probe": "Lifts the probe off the bone along its axis",
    "Robot home": "Drives the robot home, the probe drawn back first where it stands on the bone",
    # set-up
    "Cancel picking": "Leaves the region where it is",
    "Reset region": "Lets the program choose the place of the region again",
    "Excitation": "Signal that is sent: a chirp is compressed afterwards, a pulse is not",
    "Restore probe defaults": "Sets the probe parameters to those of the chosen probe",
    "Record on reference block": "Measures the delay of the line on a flat steel block",
    "Reset delay line": "Uses the nominal delay of the line again",
    "Obstacle": "Obstacle to be changed or removed, or a new one",
    "Name": "Name that is shown in lists and files",
    "Add obstacle": "Adds the box above to the work cell",
    "Remove obstacle": "Removes the chosen obstacle from the work cell",
    "Load skull file…": "Reads a mask, a CT volume or a mesh and places it as the skull",
    # tool and pointer
    "Number of poses": "How many poses from the selected one on",
    "Exclude": "Leaves the selected poses out of the fit, or includes them again",
    "Include all poses": "Fits with every pose that was recorded",
    "Pose": "Click a pose to select it",
    "Pivot by hand": "Pivot the pointer yourself with the handles in the scene",
    "Finish and calibrate": "Ends the recording and fits the pointer tip",
    "Fit again": "Fits the recorded poses once more, by the chosen method",
    "Load tool geometry…": "Reads where the markers are in the tool, for the next import",
    "Choose file…": "Reads a recording from a file and takes it into this step",
    # surface and path
    "Lift pointer": "The next click begins a new stroke; nothing is sampled on the way to it",
    "Draw on the skull": "Draw a stroke with the mouse; the virtual hand follows it",
    "Finish stroke": "Records the drawn stroke with the tracked pointer",
    "Undo last point": "Takes back the last point of what is being drawn",
    "Discard stroke": "Deletes what was drawn since the last recording",
    "Rebuild point cloud": "Computes the surface points from the recorded strokes again",
    "Delete strokes": "Deletes all strokes of the surface; undo brings them back",
    "Register loaded skull": "Fits the loaded skull to the measured surface points",
    "Append to strokes": "Off: the imported recording replaces the strokes",
    "Paint region to scan": "Drag over the skull: patterns and further passes fill this alone",
    "Paint region to avoid": "Drag over the skull: no path and no further pass comes here",
    "Finish painting": "Ends painting; what was painted stays",
    "Clear painted regions": "Deletes all painted strokes; undo brings them back",
    "Pick centre": "Click the skull to place the centre of the pattern",
    "Draw boundary": "Click the skull to draw a boundary around the pattern",
    "Done": "Ends picking, drawing or editing",
    "Clear centre and boundary": "Places the pattern in the region of step 1 again",
    "Generate pattern": "Replaces the path by the pattern",
    # smoothing
    "Edit": "Move, insert, delete or pin path points in the scene",
    "Discard edits": "Goes back to the smoothed path as it was computed",
    "Point no.": "Selects a point of the smoothed path; it is marked in the scene",
    "Insert point after": "Puts a point half-way to the next one",
    "Delete this point": "Takes the selected point out of the path",
    # roll
    "Find base pose": "Searches robot base poses that reach the whole path",
    "Use nearest pose": "Moves the base as little as needed",
    "Use pose with largest margin": "Moves the base to where the robot is freest",
    "Roll": "Click a column to show this roll, and to plan with it if it is feasible",
    "Show selected roll": "Shows the planned roll again",
    "Path colour": "Margin that colours the path in the scene",
    "Joint": "Joint that the graph shows alone",
    # scan
    "Verify on landmarks": "The pointer touches the landmarks the robot knows, and is compared",
    "Reason": "Why the robot may scan although the verification failed; the log keeps it",
    "Override verification": "Lets the robot scan for the reason above",
    "Quick look": "Short lines with each probe by hand tell which one maps more of the region",
    "Record on gauge plate": "Measures where the probe face is, on a steel gauge plate",
    "Reset mounting": "Uses the probe mounting as drawn again",
    "A-scans of": "Scan whose A-scans are shown",
    "A-scan": "Click a place along the path to show its A-scan",
    "Boundary": "Boundary that is set by hand",
    "Time (µs)": "Time of flight at which the boundary is set",
    "Set boundary": "Sets the boundary of this A-scan at the chosen time",
    "Use other echo": "Takes the echo nearest to the chosen time",
    "Delete boundary": "Marks the boundary of this A-scan as not visible",
    "Reset this A-scan": "Takes the detected boundary of this A-scan again",
    "Reset all A-scans": "Takes all detected boundaries again",
    "Horizontal axis": "Whether the force is drawn over path or time",
    # maps
    "Measure with caliper": "Measures the bone at a few places, to calibrate the speed of sound",
    "Measure more": "Adds caliper measurements to those there are",
    "Add point": "Adds the thickness above as a reference point",
    "Remove last point": "Removes the newest reference point",
    "Calibrate speed": "Fits the speed of sound to the reference points",
    "Show": "What is drawn in the scene",
    "Colour by": "Quantity that colours the maps",
    "Plan tilted passes": "Plans the scan path again with the probe tilted, each time another way",
    "Scan tilted pass": "The robot scans the next planned pass",
    "Map with tilted passes": "Maps all passes together",
    "1. Calibrate probe": "Finds the probe face in the marker of the handheld probe",
    "2. Start handheld scan": "The virtual hand scans the region without the robot",
    "3. Map handheld scan": "Detects the boundaries in the handheld scan",
    "Show maps of": "Robot or handheld scan",
    "Slices": "Draws two slices through the echo volume",
    "u (mm)": "Position of the slice across u",
    "v (mm)": "Position of the slice across v",
    "Iso-surface": "Draws the surface of equal echo level",
    "Level (dB)": "Echo level of the iso-surface, below the strongest echo",
    "In the file (mm)": "Place of a point in the coordinates of the reference's file",
    "In base (mm)": "Place of the same point on the patient, in the frame of the robot base",
    "Point at it on the skull": "Click the skull: the pointer measures the place in base there",
    "Add the pair": "Adds both places as a pair; three or more lay the reference",
    "Pair": "Pair of the table that is to be removed",
    "Remove this pair": "Removes the chosen pair of points",
    "Bone threshold": "From which value a reference CT is bone; a mask needs none",
    "Reference": "How the reference is laid over the maps",
    "Compare with a file…": "Compares the maps with a mesh or volume of the same bone",
    "Compare with the true bone": "Compares with the simulated bone instead of the file",
    "File": "File that the button below opens or downloads",
    "Download maps": "Saves the maps in the chosen format",
    # implant bed
    "Register burr": "Turns the burr about its tip in a fixed seat, to know where the tip is",
    "Find lines": "Finds the scan lines that tell most of the bone below this bed",
    "Plan pass along them": "Plans a further pass of the robot along these lines",
    "Plan milling": "Searches a roll about the burr with which the robot can mill the bed",
    "Rehearse milling": "Mills the virtual bone: force, scan of the floor, depth corrected",
    "Download captures": "Saves recordings or transforms in the chosen format",
    "Download motion": "Saves the certified motion in the chosen format",
    "Download bed": "Saves bed or milling path in the chosen format",
    # comparison of probes, replay
    "Probes": "Probes to be compared",
    "Bone": "Kind of bone of the virtual plates",
    "Run sweep": "Simulates and detects echoes for each combination",
    "Motion (%)": "Position along the planned motion",
    "Replay": "Play, pause, go back to the start, or show the live robot",
    "Speed": "Multiple of real time",
}


DECIMALS = 6  # that a number field shows; viser takes those of its step
MOST_CHARS = 40  # of a refused text that are shown
TYPED = ("add_text", "add_number", "add_vector3", "add_slider")  # fields that text is typed into
OTHERS = ("add_button", "add_upload_button", "add_button_group", "add_checkbox", "add_dropdown")
_UNIT = re.compile(r"\(([^()]+)\)$")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+")  # or a decimal comma: ambiguous


def read_number(text: str) -> float:
    """Return a typed text as a number; a comma may stand for the point.

    Raises:
        InvalidInputError: it is none, or 1,000 that may be one or a thousand.
    """
    plain = text.strip().replace("\N{MINUS SIGN}", "-")
    if not _THOUSANDS.fullmatch(plain):
        plain = plain.replace(",", ".") if plain.count(",") == 1 else plain
        if _NUMBER.fullmatch(plain) and abs(value := float(plain)) < float("inf"):
            return value
    raise InvalidInputError(f"expected a number such as 2.5, not {text.strip()[:MOST_CHARS]!r}")


@dataclass(frozen=True, slots=True)
class Typed:
    """Event of a finished field, in place of viser's event."""

    client: Any
    target: Any
    finished: bool = True  # nothing more comes: it need not settle


class Field:
    """A field of viser under the same names, which can be filled from a typed text.

    ``explain(words)`` shows words below it.
    """

    def __init__(
        self, handle: Any, label: str, beside: Any = None, hint: str | None = None
    ) -> None:
        """Take a handle; ``beside`` is the HTML that stands below it, with its hint."""
        self.__dict__.update(
            _handle=handle, _label=label, _beside=beside, _hint=hint, _words="", _calls=[]
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)

    def __setattr__(self, name: str, value: Any) -> None:
        moved = name == "value" and value != self._handle.value
        setattr(self._handle, name, value)
        if moved or (name == "visible" and not value):
            self.explain("")

    def explain(self, words: str) -> None:
        """Show words below the field, as why a text was refused; none with an empty text."""
        if self._beside is not None and words != self._words:
            self.__dict__["_words"] = words
            self._beside.content = _beside(uuid_of(self._handle), self._hint, words)

    def remove(self) -> None:
        """Remove the field and what stands below it."""
        self._handle.remove()
        if self._beside is not None:
            self._beside.remove()

    def on_update(self, call: Callable[[Any], Any]) -> Any:
        """Call ``await call(event)`` whenever the field changes."""
        self._calls.append(call)
        return self._handle.on_update(call)

    def take(self, text: str, part: int) -> bool:
        """Write a typed text into the field, or a component of it; return whether that changed it.

        Raises:
            InvalidInputError: no number where one is expected, or outside of the limits.
        """
        if self._handle.disabled:
            raise InvalidInputError(
                f"{self._label} cannot be changed now: wait for the job or cancel it"
            )
        held = self._handle.value
        if isinstance(held, tuple):
            value: Any = tuple(
                self._number(text, old, at) if at == part else old for at, old in enumerate(held)
            )
        else:
            value = text if isinstance(held, str) else self._number(text, held, None)
        self._handle.value = value
        return value != held

    def _number(self, text: str, held: float, part: int | None) -> float:
        try:
            value = read_number(text)
        except InvalidInputError as error:
            raise InvalidInputError(f"{self._label}: {error}") from None
        if isinstance(held, int) and value != int(value):
            raise InvalidInputError(f"{self._label}: expected a whole number, not {value:.12g}")
        low, high = (
            limit[part] if part is not None and isinstance(limit, tuple) else limit
            for limit in (self._handle.min, self._handle.max)
        )
        if (low is not None and value < low) or (high is not None and value > high):
            least = "any" if low is None else f"{low:.12g}"
            most = "any" if high is None else f"{high:.12g}"
            raise InvalidInputError(f"{self._label} must be {least} to {most}, not {value:.12g}")
        return type(held)(value)

    async def notify_listeners(self, client: Any) -> None:
        """Tell all who listen that ``client`` has finished typing."""
        for call in self._calls:
            await call(Typed(client, self))


def full_hint(hint: str | None, label: str, low: Any = None, high: Any = None) -> str | None:
    """Return a hint with the limits of a number and its unit, which the label ends with."""
    if not isinstance(low, int | float) or not isinstance(high, int | float):
        return hint
    unit = _UNIT.search(label)
    limits = f"{low:.12g} to {high:.12g}{f' {unit[1]}' if unit else ''}."
    return f"{hint.rstrip('.')}. {limits}" if hint else limits


def _beside(uuid: str, hint: str | None, words: str = "") -> str:
    """Return what stands below a control: its hint, which the page shows on hover, and words."""
    hidden = "" if not hint else f'<i hidden data-hint-for="{escape(uuid)}">{escape(hint)}</i>'
    return hidden + (f'<div class="r-wrong" role="note">{escape(words)}</div>' if words else "")


class Fields:
    """The gui of one browser; its fields for texts and numbers wait until the typing is finished.

    ``refuse(error, event, explained)`` reports what could not be taken.
    """

    def __init__(self, gui: Any, refuse: Callable[[Exception, Event, bool], None]) -> None:
        self._gui, self._refuse = gui, refuse
        self._fields: dict[str, Field] = {}
        self._explained: Field | None = None
        message = gui.add_text(
            "Typed", "{}", visible=False
        )  # what the page sends when it is finished
        message.on_update(self._typed)
        gui.add_html(f'<i hidden data-typed="{escape(uuid_of(message))}"></i>')

    def __getattr__(self, name: str) -> Any:
        """Return what the gui has; texts and numbers are added as fields that wait."""
        made = getattr(self._gui, name)
        if name not in (*TYPED, *OTHERS):
            return made

        def add(label: str, *rest: Any, **options: Any) -> Any:
            limits = rest[:2] if name == "add_slider" else (options.get("min"), options.get("max"))
            own = options.get("hint") or HINTS.get(label)
            hint = options["hint"] = full_hint(own, label, *limits)
            handle = made(label, *rest, **options)
            uuid = uuid_of(handle)
            if name in OTHERS:
                if hint:
                    self._gui.add_html(_beside(uuid, hint))
                return handle
            if name in ("add_number", "add_vector3") and not isinstance(handle.value, int):
                handle.precision = DECIMALS  # more than the step has
            beside = self._gui.add_html(_beside(uuid, hint))
            field = self._fields[uuid] = Field(handle, label, beside, hint)
            return field

        return add

    async def _typed(self, event: Any) -> None:
        if event.client is None:
            return
        if self._explained is not None:
            self._explained.explain("")
        try:
            field, part, text = self._read(event.target.value)
        except InvalidInputError as error:
            self._refuse(error, event, False)
            return
        try:
            changed = field.take(text, part)
        except InvalidInputError as error:
            self._explained = field
            field.explain(str(error))
            self._refuse(error, event, True)
            return
        if changed:
            await field.notify_listeners(event.client)

    def _read(self, message: str) -> tuple[Field, int, str]:
        """Return field, component and text of what the page sent."""
        try:
            sent = json.loads(message)
            field = self._fields[sent["field"]]
            part, text = sent["part"], sent["text"]
            if not isinstance(part, int) or not isinstance(text, str):
                raise TypeError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InvalidInputError(
                "expected a field of this page and a text: load the page again"
            ) from None
        return field, part, text
