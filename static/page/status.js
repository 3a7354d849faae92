// The state of the program as it streams in: session, job, devices, connection.

import { $, API, follow, say, tell } from "./base.js";
import { viewer } from "./link.js";

function show(state) {
  const session = state.session;
  $("name").textContent = session ? session.name : "no session open";
  $("sessionbutton").title = session ? `${session.name}: revision ${session.revision}, seed ${session.seed}` : "";
  const saved = $("saved");
  const lacks = session?.recovered ? "● recovered, not saved" : "● not saved";
  const file = { changed: "Another program has changed the file. ", missing: "The file has been removed. " }[session?.file_state] ?? "";
  saved.textContent = !session ? "" : session.saved ? "saved" : lacks;
  const copy = { kept: "A recovery copy is kept", failed: "No space for a recovery copy" }[session?.copy];
  saved.title = session?.saved ? `in ${session.file}` : file + (copy ?? "");
  saved.classList.toggle("changed", Boolean(session) && !session.saved);
  document.title = session ? `${session.saved ? "" : "● "}${session.name} – RONA` : "RONA";
  $("origin").textContent = state.origin || "NO DEVICES";
  $("origin").dataset.origin = state.origin || "";
  const job = state.jobs[0];
  $("job").hidden = !job;
  if (job) {
    $("activity").textContent = job.words;
    $("job").title = job.words;
    $("progress").value = job.progress;
    $("percent").textContent = `${Math.round(100 * job.progress)} %`;
  }
}

function connection(state, text) {
  $("link").dataset.state = state;
  $("link").title = text;
  $("linktext").textContent = text;
}

export function watch() {
  const source = new EventSource(`${API}/status/events`);
  let refocus = false;
  source.onopen = () => {
    connection("up", "connected");
    if (refocus) viewer.contentWindow.focus(); // the viewer reconnects only while it has focus
    refocus = false;
  };
  source.addEventListener("status", (event) => tell("status", JSON.parse(event.data)));
  source.onerror = async () => {
    refocus = true;
    connection("down", "no connection");
    let status = 0;
    try { status = (await fetch(`${API}/status`)).status; } catch { /* the server is away */ }
    if (status === 401) {
      source.close();
      connection("down", "access expired");
      say("Open the address that rona serve printed", true, 3600);
    } else if (source.readyState === EventSource.CLOSED) {
      setTimeout(watch, 2000);
    }
  };
}

follow("status", show);
