// Keys of the commands; they rest during typing, and while something lies over the page.

import { all, enabled, run } from "./commands.js";
import { inside, listen } from "../link.js";

const NOT_TYPED = ["checkbox", "radio", "range", "button", "submit", "color", "file"];

export const typing = (target) =>
  target?.matches?.("textarea, select, [contenteditable=true]")
  || (target?.matches?.("input") && !NOT_TYPED.includes(target.type) && !target.readOnly);

const covered = () => document.querySelector("dialog[open]") !== null
  || inside()?.querySelector("[role=dialog] :focus") != null;

function spelt(event) {
  const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
  const shift = event.shiftKey && /^(Enter|[A-Z])$/.test(key) ? "Shift+" : "";
  return `${event.ctrlKey || event.metaKey ? "Ctrl+" : ""}${event.altKey ? "Alt+" : ""}${shift}${key}`;
}

function onKey(event) {
  if (event.isComposing || event.defaultPrevented) return;
  const wanted = spelt(event);
  const command = all().find((each) => !each.shownOnly && (each.key === wanted || each.also?.includes(wanted)));
  if (!command) return;
  const landing = document.body.dataset.view !== "session";
  if (covered() && command.id !== "palette") return;
  if (landing && !command.everywhere) return;
  if (typing(event.target) && !command.anywhere) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (!event.repeat || command.group === "Edit") { if (enabled(command)) run(command); }
}

listen("keydown", onKey);
