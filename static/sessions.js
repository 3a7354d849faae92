"use strict";
// Sessions as a whole: what an earlier run left unsaved, and what is asked before work goes out of sight.

const STEP_WORDS = {
  setup: "Set-up", tool: "Tool", pointer: "Pointer", surface: "Surface", path: "Path",
  smoothing: "Smoothing", roll: "Roll", scan: "Scan", maps: "Maps",
  implant: "Implant bed",
};
let shown = null; // the newest state of the program
let offered = -1; // how many unsaved sessions the list has

function element(name, text, kind = "") {
  const made = document.createElement(name);
  made.textContent = text; // names come from outside: text, never markup
  made.className = kind;
  return made;
}

function button(text, kind, act) {
  const made = element("button", text, `plain ${kind}`);
  made.type = "button";
  made.addEventListener("click", act);
  return made;
}

// ---------------------------------------------------------------- unsaved work of an earlier run

function when(utc) {
  const then = new Date(utc), now = new Date();
  const time = then.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  if (then.toDateString() === now.toDateString()) return `today, ${time}`;
  return `${then.toLocaleDateString([], { day: "numeric", month: "long", year: "numeric" })}, ${time}`;
}

function steps(lost) {
  const names = (list) => list.map((name) => STEP_WORDS[name] ?? name).join(", ");
  const done = `${lost.steps_done.length} of ${Object.keys(STEP_WORDS).length} steps done: ${names(lost.steps_done)}`;
  return lost.steps_stale.length ? `${done}; to be repeated: ${names(lost.steps_stale)}` : done;
}

function row(lost) {
  const item = element("li", ""), words = document.createElement("div");
  const size = `${(lost.size_bytes / 1e6).toFixed(1)} MB`;
  words.append(element("b", lost.name ?? "Unreadable copy"));
  words.append(element("small", `changed ${when(lost.changed_utc)} · ${size}`));
  if (lost.name !== null) words.append(element("small", steps(lost)));
  if (lost.problem) words.append(element("small", lost.problem, "bad"));
  const ask = () => {
    const sure = button("Discard permanently", "lose", () => act(lost, "DELETE", ""));
    item.replaceChildren(words, sure, button("Keep", "", () => item.replaceWith(row(lost))));
    sure.focus();
  };
  item.append(words, button("Discard", "", ask));
  if (lost.name !== null) item.append(button("Recover", "primary", () => act(lost, "POST", "/open")));
  return item;
}

async function act(lost, method, path) {
  try {
    const answer = await send(method, `/recoverable/${encodeURIComponent(lost.key)}${path}`);
    if (method === "DELETE") {
      say("Discarded");
    } else {
      const { session, problem } = await answer.json();
      say(problem ? `“${session.name}” is open, but ${problem}` : `“${session.name}” is open again, not saved yet`, Boolean(problem), problem ? 30 : 6);
    }
  } catch (error) {
    say(error.message, true, 15);
  }
  await offer();
}

async function offer(ask = true) {
  let found = [];
  try {
    found = (await (await send("GET", "/recoverable")).json()).recoverable;
  } catch (error) {
    say(error.message, true, 15);
  }
  $("lostlist").replaceChildren(...found.map(row));
  if (!found.length) $("lost").close();
  else if (ask && !$("lost").open) $("lost").show(); // not modal: Stop stays in reach
  $("lostlist").querySelector(".primary")?.focus();
}

$("lostbutton").addEventListener("click", () => offer());
$("lostlater").addEventListener("click", () => {
  sessionStorage.setItem("later", shown?.run ?? "");
  $("lost").close();
});

// ---------------------------------------------------------------- before work goes out of sight

function leaveFor(words) {
  const session = shown?.session;
  if (!session?.changes) return Promise.resolve("keep");
  $("leavetitle").textContent = `Save “${session.name}” first?`;
  $("leavetext").textContent = `“${session.name}” has unsaved changes. You are about to ${words}. Without saving, `
    + `“${session.name}” stays open in the background: return to it with Session, Open sessions.`;
  $("leave").show();
  $("leavesave").focus();
  return new Promise((resolve) => {
    for (const answer of ["cancel", "keep", "save"]) {
      $(`leave${answer}`).onclick = () => { $("leave").close(); resolve(answer); };
    }
  });
}

$("demo").addEventListener("click", async () => {
  const session = shown?.session;
  const answer = await leaveFor("open the demo");
  if (answer === "cancel") return;
  try {
    if (answer === "save") await post(`/sessions/${session.id}/save`);
    await post("/sessions/demo");
    say("A copy of the demo session is open");
  } catch (error) {
    say(error.message, true, 15);
  }
});

// ---------------------------------------------------------------- state

document.addEventListener("status", ({ detail: state }) => {
  if (shown && shown.run !== state.run) { // the program was started anew: what is drawn is of the old one
    location.reload();
    return;
  }
  shown = state;
  $("lostbutton").hidden = !state.recoverable;
  $("lostbutton").textContent = `Recover (${state.recoverable})`;
  if (state.recoverable !== offered) {
    offered = state.recoverable;
    offer(sessionStorage.getItem("later") !== state.run);
  }
});
