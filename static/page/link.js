// Link to the viewer in its frame: its view as it is, and what the page asks of it.
// The other end is rona_ui/panels/layout/page_link.py.

import { $, tell } from "./base.js";

export const viewer = $("viewer");
export const link = { view: null, fields: null }; // the view of this browser; what is typed in docks
const SETTLE_MS = 40;
const KEY = "ronaPage";
const NAME = stored((items) => items.getItem(KEY)) ?? Math.random().toString(36).slice(2);
let listened = null; // the document whose keys reach us
let lastState = ""; // the state that was read last
let asked = 0;
let linked = null; // uuid of the field that our name was sent to
const listeners = []; // of keys and presses, here and in the frame

// The name outlives our connections, and that we are loaded anew; a copy of our tab finds none.
function stored(act) {
  try { return act(sessionStorage); } catch { return null; } // the browser keeps nothing
}
addEventListener("pageshow", () => stored((items) => items.removeItem(KEY)));
addEventListener("pagehide", () => stored((items) => items.setItem(KEY, NAME)));

export const inside = () => viewer.contentDocument;

// Call `act(event)` first of all, in the page and in the frame.
export function listen(kind, act) {
  listeners.push([kind, act]);
  window.addEventListener(kind, act, true);
  if (listened) viewer.contentWindow.addEventListener(kind, act, true);
}

// Ask the viewer's end for something, in the order of what its fields send; return whether
// there is a document to ask.
export function act(what, value = null) {
  const end = inside()?.querySelector("[data-page]");
  const page = viewer.contentWindow;
  if (!end || !page.__viserMutable?.sendMessage) return false;
  const wish = JSON.stringify({ act: what, value, number: ++asked });
  page.__viserMutable.sendMessage({ type: "GuiUpdateMessage", uuid: end.dataset.page, updates: { value: wish } });
  return true;
}

// A button of the docks by its name: one of the run bar's, or that of a step.
export function docked(name) {
  const id = link.view?.buttons[name];
  return id === undefined ? null : inside().getElementById(id);
}

function read() {
  const end = inside()?.querySelector("[data-page]");
  if (end && end.dataset.page !== linked && act("resume", NAME)) { // as it was on another connection
    linked = end.dataset.page;
    tell("linked");
  }
  if (end && end.dataset.state !== lastState) {
    lastState = end.dataset.state;
    link.view = JSON.parse(lastState);
    tell("view", link.view);
  }
  tell("drawn", inside()); // something in the docks has changed
}

function enter() {
  // Same origin: a key pressed in the viewer, in an input field too, reaches us first.
  const page = inside();
  if (!page?.body || page === listened || page.URL === "about:blank") return;
  listened = page;
  lastState = "";
  link.view = null;
  for (const [kind, call] of listeners) viewer.contentWindow.addEventListener(kind, call, true);
  link.fields = new FieldKeeper(viewer.contentWindow); // static/fields.js
  let waits = 0;
  const changed = () => {
    waits ||= setTimeout(() => { waits = 0; if (page === listened) read(); }, SETTLE_MS);
  };
  new viewer.contentWindow.MutationObserver(changed).observe(page.body, {
    subtree: true, childList: true, attributes: true, attributeFilter: ["data-state", "disabled", "style", "class"],
  });
  tell("entered", page);
  changed();
}

viewer.addEventListener("load", enter);
export const begin = () => enter(); // the frame may have come before us
