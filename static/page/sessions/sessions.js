// Sessions as a whole: the session menu, names, and what is asked before work goes out of sight.

import { $, API, Refused, ask, follow, program, say, send, trying, when } from "../base.js";
import { find, register, run } from "../commands/commands.js";
import { act, link } from "../link.js";
import { Menu, close, entry, heading, line } from "../commands/menus.js";
import { onEscape } from "../stop.js";
import { showHome, showSession } from "../views.js";

const RECENT = 5; // files in the menu; the start page has all
let files = [];

const current = () => program.state?.session;
// The session in sight as the program holds it now; what streams in may be a moment older.
const held = async () => (current() ? ask(`/sessions/${current().id}`) : null);

// ---------------------------------------------------------------- questions

// Ask something over the page; return which of the answers was given, `cancel` by Esc.
function question(title, text, answers) {
  $("leavetitle").textContent = title;
  $("leavetext").textContent = text;
  for (const name of ["cancel", "keep", "lose", "save"]) {
    $(`leave${name}`).hidden = name !== "cancel" && !(name in answers);
    if (answers[name]) $(`leave${name}`).textContent = answers[name];
  }
  $("leave").show(); // not modal: Stop stays in reach
  $(answers.save ? "leavesave" : "leavecancel").focus();
  return new Promise((resolve) => {
    for (const name of ["cancel", "keep", "lose", "save"]) {
      $(`leave${name}`).onclick = () => { $("leave").close(); resolve(name); };
    }
  });
}

onEscape(() => { const was = $("leave").open; if (was) $("leavecancel").click(); return was; });

const put = async (id, body) => {
  const saved = await (await send("POST", `/sessions/${id}/save`, body)).json();
  say(`Saved in ${saved.file}`);
  return true;
};

// Save before the session goes out of sight; return whether it is saved.
async function saveFile({ id, name }) {
  try {
    return await put(id, {});
  } catch (error) {
    if (error.code !== "file_changed") throw error;
    return conflict({ id, name });
  }
}

// Ask what is to be done where another program has changed the file; return whether it is saved now.
async function conflict({ id, name }) {
  const answer = await question(`The file of “${name}” has changed`,
    "Another program has changed it since you opened or saved it here. Save as… keeps both. Reload opens the file and "
    + "discards what you changed here. Overwrite replaces the file; what was in it stays beside it as .bak.",
    { save: "Save as…", keep: "Reload", lose: "Overwrite" });
  if (answer === "lose") return put(id, { replace: true });
  if (answer === "save") saveAs(`${name} 2`);
  if (answer === "keep") await send("POST", `/sessions/${id}/reload`);
  return false;
}

// Save goes through the viewer, after what is being typed there; where the file has changed, the
// program refuses and says so in its state.
const ANSWER_MS = 5000; // within which a refusal belongs to what was pressed
let saving = { id: "", until: 0 }; // the session that is being saved so
function save() {
  saving = { id: current().id, until: Date.now() + ANSWER_MS };
  act("save");
  meet(current());
}

function meet(session) {
  if (session?.id !== saving.id || session.file_state !== "changed" || Date.now() > saving.until) return;
  saving.until = 0;
  trying(() => conflict(session));
}

follow("status", ({ session }) => meet(session));

// Put another session in sight by `work()`; ask first where the present one is not saved.
export async function leaveFor(words, work) {
  const session = await held();
  if (session?.changes) {
    const answer = await question(`Save “${session.name}” first?`,
      `“${session.name}” has unsaved changes. You are about to ${words}. Without saving, “${session.name}” `
      + "stays open in the background: return to it by the session menu.",
      { save: "Save first", keep: "Keep open, unsaved" });
    if (answer === "cancel") return;
    if (answer === "save" && !await saveFile(session)) return;
  }
  if (await work() !== false) showSession();
}

// Open a file; where it is damaged, offer its last good copy. Return whether a session was opened.
async function openOrCopy(file) {
  try {
    await send("POST", "/sessions/open", { file });
  } catch (error) {
    if (!error.backup) throw error;
    const answer = await question(`“${file}” cannot be opened`,
      `${error.message}. It is opened as a session that is not saved.`, { keep: "Open the last good copy" });
    if (answer !== "keep") return false;
    await send("POST", "/sessions/open", { file, backup: true });
  }
  return true;
}

export const openDemo = () => leaveFor("open the demo", () => send("POST", "/sessions/demo"));
export const openNew = () => leaveFor("start a new session", () => send("POST", "/sessions", {}));
export const openFile = (file) => leaveFor(`open ${file}`, () => openOrCopy(file));
export const showOpen = (id) => trying(async () => { await send("POST", `/sessions/${id}/current`); showSession(); });

export function openUpload(file) {
  return leaveFor(`open ${file.name}`,
    () => send("POST", `/sessions/upload?name=${encodeURIComponent(file.name.slice(-120))}`, file));
}

async function closeSession() {
  const { id, name, changes } = await held();
  const busy = (await ask("/jobs")).some((job) => job.session === id && !job.finished);
  if (changes || busy) {
    const why = changes ? "has unsaved changes" : "has a running job";
    const loses = changes ? "the changes are lost" : "the job is cancelled";
    const answer = await question(`Close “${name}”?`, `“${name}” ${why}. If you close it now, ${loses}.`,
      { save: "Save and close", lose: "Close without saving" });
    if (answer === "cancel") return;
    if (answer === "save" && !await saveFile({ id, name })) return;
  }
  const last = program.state.sessions.length === 1;
  await send("DELETE", `/sessions/${id}`);
  if (last) showHome();
}

// ---------------------------------------------------------------- names

// Ask for a name; `work(name)` takes it, and throws where it cannot.
function naming(title, verb, value, work) {
  $("namingtitle").textContent = title;
  $("namingdo").textContent = verb;
  $("namingfield").value = value;
  $("namingwhy").textContent = "";
  $("naming").show();
  $("namingfield").select();
  $("namingform").onsubmit = async (event) => {
    event.preventDefault();
    try {
      await work($("namingfield").value.trim());
      $("naming").close();
    } catch (error) {
      $("namingwhy").textContent = error.message;
    }
  };
}

function leaveNaming() {
  const was = $("naming").open;
  $("naming").close();
  if (was) $("sessionbutton").focus();
  return was;
}

$("namingcancel").addEventListener("click", leaveNaming);
onEscape(leaveNaming);

function rename() {
  const { id, name } = current();
  naming("Rename the session", "Rename", name, (wanted) => send("POST", `/sessions/${id}/commands/RenameSession`, { name: wanted }));
}

function saveAs(suggested) {
  const { id, name, file } = current();
  let refused = ""; // a name that is taken: given again, it is replaced
  naming("Save in a file of another name", "Save", suggested ?? (file ?? name).replace(/\.rona$/, ""), async (wanted) => {
    try {
      await send("POST", `/sessions/${id}/save`, { file: wanted, replace: refused === wanted });
      say(`Saved in ${current().file ?? wanted}`);
    } catch (error) {
      if (!["name_taken", "file_changed"].includes(error.code)) throw error;
      refused = wanted;
      $("namingdo").textContent = "Replace";
      throw new Refused(`There is a file “${wanted}” already. Replace it? What was there stays beside it as .bak.`, error);
    }
  });
}

$("namingfield").addEventListener("input", () => {
  if ($("namingdo").textContent === "Replace") $("namingdo").textContent = "Save";
});

// ---------------------------------------------------------------- the menu

function fetchFile(path) {
  const made = document.createElement("a");
  made.href = API + path;
  made.download = "";
  made.click();
}

function fill(list) {
  const session = current(), id = session?.id;
  const command = (name, text) => entry(list, text ?? find(name).title, () => run(find(name)), { more: find(name).key ?? "" });
  command("new");
  command("open");
  command("demo");
  if (session) {
    line(list);
    command("save");
    command("saveas");
    command("rename");
    command("download");
    command("close");
  }
  const others = program.state?.sessions ?? [];
  if (others.length > 1) {
    heading(list, "Open sessions");
    for (const each of others) {
      entry(list, each.name, () => showOpen(each.id), { on: each.id === id, more: each.changes ? "not saved" : "" });
    }
  }
  if (files.length) heading(list, "Recent files");
  for (const { file, changed_utc } of files.slice(0, RECENT)) {
    entry(list, file, () => trying(() => openFile(file)), { more: when(changed_utc) });
  }
  const recordings = session ? link.view?.recordings ?? [] : [];
  if (recordings.length) heading(list, "Tracker recordings, for PLUS and 3D Slicer");
  for (const [ordinal, words] of recordings) {
    entry(list, words, () => fetchFile(`/sessions/${id}/captures/${ordinal}/file`), { more: "download" });
  }
}

const menu = new Menu($("sessionbutton"), fill);
let listed = "";
follow("status", async (state) => {
  const now = JSON.stringify(state.sessions.map(({ id, name, changes, file, saved }) => [id, name, changes, file, saved]));
  if (now === listed) return;
  listed = now;
  try { files = (await ask("/files")).files; } catch { files = []; } // the start page says why
  menu.refill();
});

register(
  { id: "new", group: "Session", title: "New session", everywhere: true, run: openNew },
  { id: "open", group: "Session", title: "Open…", key: "Ctrl+O", everywhere: true, run: () => { close(); showHome(); } },
  { id: "demo", group: "Session", title: "Demo", everywhere: true, run: openDemo },
  { id: "save", group: "Session", title: "Save", key: "Ctrl+S", icon: "save", anywhere: true,
    enabled: () => link.view && current(), run: save },
  { id: "saveas", group: "Session", title: "Save as…", enabled: current, run: () => saveAs() },
  { id: "rename", group: "Session", title: "Rename…", enabled: current, run: rename },
  { id: "download", group: "Session", title: "Download a copy", enabled: current, run: () => fetchFile(`/sessions/${current().id}/file`) },
  { id: "close", group: "Session", title: "Close session", enabled: current, run: closeSession },
);

// ---------------------------------------------------------------- after the program has been started anew

let begun = null;
follow("status", (state) => {
  if (begun !== null && begun !== state.run) location.reload(); // what is drawn is of the old one
  begun = state.run;
});

