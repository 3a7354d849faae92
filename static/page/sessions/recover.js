// Unsaved work of an earlier run: listed, recovered, discarded.

import { $, ask, button, element, follow, megabytes, say, send, when } from "../base.js";
import { showSession } from "../views.js";
import { onEscape } from "../stop.js";

const STEP_WORDS = {
  setup: "Set-up", tool: "Tool", pointer: "Pointer", surface: "Surface", path: "Path",
  smoothing: "Smoothing", roll: "Roll", scan: "Scan", maps: "Maps",
  implant: "Implant bed",
};
let offered = -1; // how many unsaved sessions the list has
let run = "";

function steps(lost) {
  const names = (list) => list.map((name) => STEP_WORDS[name] ?? name).join(", ");
  const done = `${lost.steps_done.length} of ${Object.keys(STEP_WORDS).length} steps done: ${names(lost.steps_done)}`;
  return lost.steps_stale.length ? `${done}; to be repeated: ${names(lost.steps_stale)}` : done;
}

function row(lost) {
  const item = element("li", ""), words = document.createElement("div");
  words.append(element("b", lost.name ?? "Unreadable copy"));
  words.append(element("small", `changed ${when(lost.changed_utc)} · ${megabytes(lost.size_bytes)}`));
  if (lost.name !== null) words.append(element("small", steps(lost)));
  if (lost.problem) words.append(element("small", lost.problem, "bad"));
  const sure = () => {
    const lose = button("Discard permanently", "lose", () => settle(lost, "DELETE", ""));
    item.replaceChildren(words, lose, button("Keep", "", () => item.replaceWith(row(lost))));
    lose.focus();
  };
  item.append(words, button("Discard", "", sure));
  if (lost.name !== null) item.append(button("Recover", "primary", () => settle(lost, "POST", "/open")));
  return item;
}

async function settle(lost, method, path) {
  try {
    const answer = await send(method, `/recoverable/${encodeURIComponent(lost.key)}${path}`);
    if (method === "DELETE") {
      say("Discarded");
    } else {
      const { session, problem } = await answer.json();
      say(problem ? `“${session.name}” is open, but ${problem}` : `“${session.name}” is open again, not saved yet`, Boolean(problem), problem ? 30 : 6);
      showSession();
    }
  } catch (error) {
    say(error.message, true, 15);
  }
  await offer(false);
}

// Read the list anew: on the start page it stands among the rest, over a session it asks.
async function offer(over) {
  let found = [];
  try {
    found = (await ask("/recoverable")).recoverable;
  } catch (error) {
    say(error.message, true, 15);
  }
  for (const list of ["lostlist", "homelost"]) $(list).replaceChildren(...found.map(row));
  $("homelostpart").hidden = !found.length;
  if (!found.length) $("lost").close();
  else if (over && !$("lost").open) {
    $("lost").show(); // not modal: Stop stays in reach
    $("lostlist").querySelector(".primary")?.focus();
  }
}

function later() {
  const was = $("lost").open;
  if (was) sessionStorage.setItem("later", run);
  $("lost").close();
  return was;
}

$("lostbutton").addEventListener("click", () => offer(true));
$("lostlater").addEventListener("click", later);
onEscape(later);

follow("status", (state) => {
  run = state.run;
  $("lostbutton").hidden = !state.recoverable;
  $("lostbutton").textContent = `Recover (${state.recoverable})`;
  if (state.recoverable === offered) return;
  offered = state.recoverable;
  const landing = document.body.dataset.view !== "session";
  offer(!landing && sessionStorage.getItem("later") !== state.run);
});
follow("shown", (name) => { if (name === "session") $("lost").close(); });
