"use strict";
// The bar above the viewer: shows the state of the program as it streams in, and stops the robot.

const API = "/api/v1";
const $ = (id) => document.getElementById(id);
const viewer = $("viewer");
let messageTimer = 0;

function say(text, bad = false, seconds = 6) {
  const box = $("message");
  box.textContent = text;
  box.title = text;
  box.classList.toggle("bad", bad);
  box.hidden = false;
  clearTimeout(messageTimer);
  messageTimer = setTimeout(() => { box.hidden = true; }, seconds * 1000);
}

function post(path, body) {
  return send("POST", path, body);
}

async function send(method, path, body) {
  const answer = await fetch(API + path, {
    method,
    headers: body === undefined ? {} : { "Content-Type": "application/json" },
    body: body === undefined ? undefined : JSON.stringify(body),
    keepalive: true,
  });
  if (answer.ok) return answer;
  let detail = `the server answered ${answer.status}`;
  try { detail = (await answer.json()).detail || detail; } catch { /* no JSON: keep the number */ }
  throw new Error(detail);
}

// ---------------------------------------------------------------- stop

async function stop() {
  const button = $("stop");
  button.classList.add("sent");
  try {
    await post("/sessions/current/robot/stop");
    say("Robot stopped");
  } catch (error) {
    say(`STOP FAILED: ${error.message}`, true, 30);
  } finally {
    setTimeout(() => button.classList.remove("sent"), 300);
  }
}

// Esc stops the robot wherever it is pressed; the server knows whether it moves. At rest it closes
// what is open, takes back what is being typed, or leaves drawing and editing: one of them at a time.
async function stopIfMoving() {
  try {
    const answer = await post("/sessions/current/robot/stop?if_moving=true");
    if ((await answer.json()).stopped) say("Robot stopped");
  } catch (error) {
    say(`STOP FAILED: ${error.message}`, true, 30);
  }
}

function onKey(event) {
  if (event.key !== "Escape" || event.repeat || !event.isTrusted) return;
  stopIfMoving();
  const help = $("helptext"), target = event.target;
  if (help.open || fields?.drop()) {
    help.close();
    event.preventDefault();
    event.stopImmediatePropagation();
  } else if (asked()) {
    $(asked()).click();
    event.preventDefault();
    event.stopImmediatePropagation();
  } else if (target.ownerDocument === document || (target.matches?.("input, textarea") && !opens(target))) {
    leaveMode(); // the viewer hears no Esc from here
  }
}

// Which answer leaves everything as it is, while something is asked over the page.
const asked = () => ($("leave").open ? "leavecancel" : $("lost").open ? "lostlater" : null);

// Whether Esc closes something of the viewer's own: a list of choices, the palette.
const opens = (field) => field.getAttribute("aria-expanded") === "true" || field.closest("[role=dialog]") !== null;

function leaveMode() {
  const page = viewer.contentWindow;
  page.document.body.dispatchEvent(
    new page.KeyboardEvent("keydown", { key: "Escape", code: "Escape", bubbles: true }));
}

let fields = null; // of the page that is in the viewer
let heard = null; // the document whose keys reach us

function listenIn(frame) {
  // Same origin: a key pressed in the viewer, in an input field too, reaches us first.
  const inside = frame.contentDocument;
  if (!inside || inside === heard || inside.URL === "about:blank") return;
  heard = inside;
  frame.contentWindow.addEventListener("keydown", onKey, true);
  fields = new FieldKeeper(frame.contentWindow);
}

$("stop").addEventListener("click", stop);
window.addEventListener("keydown", onKey, true);
viewer.addEventListener("load", () => { listenIn(viewer); viewer.contentWindow.focus(); });
listenIn(viewer); // it may have come before us

// ---------------------------------------------------------------- state

function show(state) {
  const session = state.session;
  $("name").textContent = session ? session.name : "no session open";
  $("name").title = session ? `${session.name} (session ${session.id}, revision ${session.revision})` : "";
  const saved = $("saved");
  const lacks = session?.recovered ? "● recovered, not saved" : "● not saved";
  saved.textContent = !session ? "" : session.saved ? `saved in ${session.file}` : lacks;
  saved.title = { kept: "A recovery copy is kept", failed: "No space for a recovery copy" }[session?.copy] ?? "";
  saved.classList.toggle("changed", Boolean(session) && !session.saved);
  document.title = session ? `${session.saved ? "" : "● "}${session.name} – RONA` : "RONA";
  $("origin").textContent = state.origin || "NO DEVICES";
  $("origin").dataset.origin = state.origin || "";
  document.dispatchEvent(new CustomEvent("status", { detail: state }));
  const job = state.jobs[0];
  $("job").hidden = !job;
  if (job) {
    $("activity").textContent = job.words;
    $("progress").value = job.progress;
    $("percent").textContent = `${Math.round(100 * job.progress)} %`;
  }
}

function connection(state, text) {
  $("link").dataset.state = state;
  $("linktext").textContent = text;
}

function follow() {
  const source = new EventSource(`${API}/status/events`);
  let refocus = false;
  source.onopen = () => {
    connection("up", "connected");
    if (refocus) viewer.contentWindow.focus(); // the viewer reconnects only while it has focus
    refocus = false;
  };
  source.addEventListener("status", (event) => show(JSON.parse(event.data)));
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
      setTimeout(follow, 2000);
    }
  };
}

$("help").addEventListener("click", () => $("helptext").show() /* not modal: Stop stays in reach */);
follow();
