// What every part of the page uses: elements, requests, messages, the newest state of the program.

export const ROOT = new URL("../../", import.meta.url).pathname; // a proxy may have us under a sub path
export const API = `${ROOT}api/v1`;
export const $ = (id) => document.getElementById(id);
let messageTimer = 0;

export function element(name, text = "", kind = "") {
  const made = document.createElement(name);
  made.textContent = text; // names come from outside: text, never markup
  made.className = kind;
  return made;
}

export function button(text, kind, act) {
  const made = element("button", text, `plain ${kind}`);
  made.type = "button";
  made.addEventListener("click", act);
  return made;
}

export function say(text, bad = false, seconds = 6) {
  const box = $("message");
  box.textContent = text;
  box.classList.toggle("bad", bad);
  box.hidden = false;
  clearTimeout(messageTimer);
  messageTimer = setTimeout(() => { box.hidden = true; }, seconds * 1000);
}

export class Refused extends Error {
  constructor(detail, { code, backup } = {}) {
    super(detail);
    this.code = code;
    this.backup = backup; // last good copy of a session file that cannot be read
  }
}

// Send a request; `body` is a value for JSON, or a Blob.
export async function send(method, path, body) {
  const raw = body instanceof Blob;
  const answer = await fetch(API + path, {
    method,
    headers: body === undefined || raw ? {} : { "Content-Type": "application/json" },
    body: body === undefined || raw ? body : JSON.stringify(body),
    keepalive: !raw,
  });
  if (answer.ok) return answer;
  let problem = {};
  try { problem = await answer.json(); } catch { /* no JSON: keep the number */ }
  throw new Refused(problem.detail || `the server answered ${answer.status}`, problem);
}

export async function ask(path) {
  return (await send("GET", path)).json();
}

// Do something that may be refused; tell why.
export async function trying(work) {
  try {
    return await work();
  } catch (error) {
    say(error.message, true, 15);
    return undefined;
  }
}

// ---------------------------------------------------------------- the state of the program

export const program = { state: null };

export function follow(kind, act) {
  document.addEventListener(kind, ({ detail }) => act(detail));
}

export function tell(kind, detail) {
  document.dispatchEvent(new CustomEvent(kind, { detail }));
}

follow("status", (state) => { program.state = state; });

export function when(utc) {
  const then = new Date(utc), now = new Date();
  const time = then.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  if (then.toDateString() === now.toDateString()) return `today, ${time}`;
  return `${then.toLocaleDateString([], { day: "numeric", month: "long", year: "numeric" })}, ${time}`;
}

export const megabytes = (bytes) => `${(bytes / 1e6).toFixed(1)} MB`;
