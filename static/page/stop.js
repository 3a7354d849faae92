// Stop for the robot, by button and by Esc; what Esc does at rest.

import { $, say, send } from "./base.js";
import { act, inside, link, listen } from "./link.js";

const closers = []; // of what lies over the page, the topmost first; true once one has closed

// Have Esc call `close()` at rest; it returns whether there was something to close.
export function onEscape(close) {
  closers.push(close);
}

export async function stop() {
  const button = $("stop");
  button.classList.add("sent");
  try {
    await send("POST", "/sessions/current/robot/stop");
    say("Robot stopped");
  } catch (error) {
    if (error.code === "not_found") say("No session is open: there is no robot to stop");
    else say(`STOP FAILED: ${error.message}`, true, 30);
  } finally {
    setTimeout(() => button.classList.remove("sent"), 300);
  }
}

// Esc stops the robot wherever it is pressed; the server knows whether it moves.
async function stopIfMoving() {
  try {
    const answer = await send("POST", "/sessions/current/robot/stop?if_moving=true");
    if ((await answer.json()).stopped) say("Robot stopped");
  } catch (error) {
    if (error.code !== "not_found") say(`STOP FAILED: ${error.message}`, true, 30);
  }
}

// Whether Esc closes something of the viewer's own: a list of choices, a dialog.
const opens = (field) =>
  field.getAttribute?.("aria-expanded") === "true" && field.matches("input") || field.closest?.("[role=dialog]");

function onKey(event) {
  if (event.key !== "Escape" || event.repeat || !event.isTrusted) return;
  stopIfMoving();
  const closed = closers.some((close) => close()) || link.fields?.drop();
  if (closed) {
    event.preventDefault();
    event.stopImmediatePropagation();
  } else if (event.target.ownerDocument !== inside() || !opens(event.target)) {
    act("escape"); // leave drawing or editing
  }
}

$("stop").addEventListener("click", stop);
listen("keydown", onKey);
