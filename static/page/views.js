// Which of the two is in sight: the start page, at the root, or the session, at session below it.

import { $, ROOT, follow, program, tell } from "./base.js";
import { link, viewer } from "./link.js";

const SESSION = `${ROOT}session`;
const CONNECT_MS = 6000; // the viewer gives up a connection after 5 s

function put(name) {
  if (document.body.dataset.view === name) return;
  document.body.dataset.view = name;
  $("home").hidden = name !== "home";
  viewer.inert = name === "home";
  if (name === "home") $("homenew").focus();
  else wakeViewer();
  tell("shown", name);
}

// The viewer connects once it is loaded, without the focus; when that has failed it tries again only
// while it has the focus. A focus that comes meanwhile would give up the connection being made, and
// what was clicked on it.
let connecting = 0; // timer

function awaitConnection() {
  clearTimeout(connecting);
  connecting = setTimeout(endWait, CONNECT_MS);
}

function endWait() {
  clearTimeout(connecting);
  connecting = 0;
  if ([document.body, viewer].includes(document.activeElement)) wakeViewer();
}

function wakeViewer() {
  if (connecting || document.body.dataset.view !== "session" || document.querySelector("dialog[open]")) return;
  viewer.contentWindow?.focus();
}

awaitConnection();
viewer.addEventListener("load", () => { if (!link.view) awaitConnection(); });
follow("linked", endWait);
for (const dialog of document.querySelectorAll("dialog")) {
  dialog.addEventListener("close", () => { if (document.activeElement === document.body) wakeViewer(); });
}

function go(name) {
  const path = (name === "home" ? ROOT : SESSION) + location.search;
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
