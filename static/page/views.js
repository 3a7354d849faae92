// Which of the two is in sight: the start page, at /, or the session, at /session.

import { $, follow, program, tell } from "./base.js";
import { viewer } from "./link.js";

const SESSION = "/session";

function put(name) {
  if (document.body.dataset.view === name) return;
  document.body.dataset.view = name;
  $("home").hidden = name !== "home";
  viewer.inert = name === "home";
  if (name === "home") $("homenew").focus();
  else wakeViewer();
  tell("shown", name);
}

// The viewer connects only while it has the focus.
function wakeViewer() {
  if (document.body.dataset.view === "session" && !document.querySelector("dialog[open]")) viewer.contentWindow?.focus();
}

viewer.addEventListener("load", wakeViewer);
for (const dialog of document.querySelectorAll("dialog")) {
  dialog.addEventListener("close", () => { if (document.activeElement === document.body) wakeViewer(); });
}

function go(name) {
  const path = (name === "home" ? "/" : SESSION) + location.search;
  if (location.pathname + location.search !== path) history.pushState(null, "", path);
  put(name);
}

export const showHome = () => go("home");
export const showSession = () => go("session");
const wanted = () => (location.pathname === SESSION ? "session" : "home");

addEventListener("popstate", () => put(program.state?.session ? wanted() : "home"));
$("logo").addEventListener("click", (event) => { event.preventDefault(); showHome(); });
follow("status", (state) => {
  if (!state.session && document.body.dataset.view === "session") showHome(); // nothing is open
});

export const beginView = () => put(wanted());
