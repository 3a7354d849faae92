// Every command of the page: one list for tool bar, palette, keys and help.

import { API, follow, program, send, trying } from "../base.js";
import { act, docked, inside, link } from "../link.js";

const session = () => program.state?.session;
const view = () => (session() ? link.view : null);
const pressable = (name) => { const found = docked(name); return found && !found.disabled ? found : null; };
const CAMERA_KEYS = {
  Overview: "O", Region: "G", Robot: "B", AP: "F", Vertex: "T", Top: "T",
  "Lateral L": "L", Left: "L", "Lateral R": "R", Right: "R",
};
const registered = [];

// A command: title, group, `run()`; `key`, `enabled()`, and `label()` where the title changes.
export function register(...commands) {
  registered.push(...commands);
}

export const find = (id) => all().find((command) => command.id === id);
export const enabled = (command) => (command.enabled ? Boolean(command.enabled()) : true);
export const label = (command) => command.label?.() ?? command.title;

export function all() {
  return [...registered, ...steps(), ...cameras()];
}

export function run(command) {
  if (!enabled(command)) return;
  link.fields?.finish(); // what is being typed counts before it
  trying(async () => command.run());
}

function steps() {
  return Object.keys(link.view?.buttons ?? {}).filter((name) => !RUN_BAR.includes(name)).map((name, index) => {
    const words = docked(name)?.textContent.replace(/^Step \d+: /, "") ?? name;
    return {
      id: `step-${name}`, group: "Steps", title: `${index + 1} ${words}`, key: String((index + 1) % 10),
      enabled: () => view() && pressable(name), run: () => docked(name).click(),
    };
  });
}

const RUN_BAR = ["start", "cancel", "continue", "next"];

function cameras() {
  return (link.view?.cameras ?? []).map((name) => ({
    id: `camera-${name}`, group: "Camera", title: name, key: CAMERA_KEYS[name],
    enabled: view, run: () => act("camera", name),
  }));
}

// ---------------------------------------------------------------- what the docks can do

const words = (name) => docked(name)?.textContent.trim();

register(
  { id: "start", group: "Step", title: "Run the step", key: "Ctrl+Enter", label: () => words("start") || "Run the step",
    enabled: () => view() && pressable("start"), run: () => docked("start").click() },
  { id: "next", group: "Step", title: "Next step", key: "N", label: () => words("next") || "Next step",
    enabled: () => view() && pressable("next"), run: () => docked("next").click() },
  { id: "continue", group: "Step", title: "Continue: open and run the next step", key: "Ctrl+Shift+Enter",
    label: () => words("continue") || "Continue: open and run the next step",
    enabled: () => view() && pressable("continue"), run: () => docked("continue").click() },
  { id: "cancel", group: "Step", title: "Cancel the job", label: () => "Cancel the job",
    enabled: () => view() && pressable("cancel"), run: () => docked("cancel").click() },
  { id: "leave", group: "Step", title: "Exit drawing or editing", key: "Esc", shownOnly: true,
    enabled: () => view()?.drawing, run: () => act("escape") },
  { id: "undo", group: "Edit", title: "Undo", key: "Ctrl+Z", icon: "undo",
    enabled: () => view() && session().can_undo, run: () => act("undo") },
  { id: "redo", group: "Edit", title: "Redo", key: "Ctrl+Shift+Z", icon: "redo",
    enabled: () => view() && session().can_redo, run: () => act("redo") },
  { id: "cut-off", group: "Cut", title: "No cut", enabled: () => view() && !view().drawing, run: () => act("cut", "off") },
  { id: "cut-lengthwise", group: "Cut", title: "Cut lengthwise", key: "X",
    enabled: () => view() && !view().drawing, run: () => act("flip", "cut") },
  { id: "cut-crosswise", group: "Cut", title: "Cut crosswise",
    enabled: () => view() && !view().drawing, run: () => act("cut", "crosswise") },
  { id: "all-layers", group: "Layers", title: "All layers", key: "Y",
    enabled: view, run: () => act("flip", "all_layers") },
  { id: "report", group: "Session", title: "Report", icon: "report", enabled: session, run: report },
  { id: "figures", group: "Session", title: "Figures of the paper", icon: "figures", enabled: session, run: figures },
  { id: "screenshot", group: "Scene", title: "Screenshot of the scene", key: "P", icon: "screenshot",
    enabled: view, run: screenshot },
);

// ---------------------------------------------------------------- report and pictures

export function download(name, blob) {
  const made = document.createElement("a");
  made.href = URL.createObjectURL(blob);
  made.download = name;
  made.click();
  setTimeout(() => URL.revokeObjectURL(made.href), 10000);
}

const plain = (name) => name.replace(/[^\p{L}\p{N}_ -]/gu, "_");

async function report() {
  const { id, name } = session();
  download(`${plain(name)}.html`, await (await send("GET", `/sessions/${id}/report`)).blob());
}

function figures() {
  window.open(`${API}/sessions/${session().id}/figures`, "_blank", "noopener");
}

const canvas = () => inside()?.defaultView.__viserMutable?.canvas ?? null;

function screenshot() {
  const name = `${plain(session().name)} ${link.view.step}.png`;
  canvas()?.toBlob((blob) => { if (blob) download(name, blob); }, "image/png");
}

const SMALL = { width: 320, height: 200 };

// Keep a small picture of the scene beside the file of a session that has just been saved.
async function keepPicture(id) {
  const from = canvas();
  if (!from?.width || link.view?.session !== id || document.body.dataset.view !== "session") return;
  const to = Object.assign(document.createElement("canvas"), SMALL);
  const scale = Math.max(SMALL.width / from.width, SMALL.height / from.height);
  const [w, h] = [from.width * scale, from.height * scale];
  to.getContext("2d").drawImage(from, (SMALL.width - w) / 2, (SMALL.height - h) / 2, w, h);
  const blob = await new Promise((made) => to.toBlob(made, "image/jpeg", 0.85));
  try {
    if (blob) await send("PUT", `/sessions/${id}/picture`, blob);
  } catch { /* changed again meanwhile: the next save has another */ }
}

let before = null;
follow("status", ({ session: now }) => {
  if (now?.saved && before?.id === now.id && !before.saved) keepPicture(now.id);
  before = now;
});
