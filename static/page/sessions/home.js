// Start page: new, open, demo, recent files with their pictures, state of the devices.

import { $, API, ask, element, follow, megabytes, program, trying, when } from "../base.js";
import { openDemo, openFile, openNew, openUpload, showOpen } from "./sessions.js";

// ---------------------------------------------------------------- what it lists

function card(file, name, words, act) {
  const made = element("button", "", "card"), text = element("span", "", "words");
  made.type = "button";
  if (file) {
    const image = new Image();
    image.src = file;
    image.alt = "";
    made.append(image);
  } else {
    made.append(element("span", "no picture yet", "blank"));
  }
  text.append(element("b", name), element("small", words));
  made.append(text);
  made.addEventListener("click", () => trying(act));
  return made;
}

function state(session) {
  if (!session.changes) return session.saved ? `saved in ${session.file}` : "as it was opened, not saved";
  return session.recovered ? "● recovered, not saved" : "● not saved";
}

async function refresh() {
  const opened = program.state?.sessions ?? [];
  $("homeopenpart").hidden = !opened.length;
  $("homeopen").replaceChildren(...opened.map((session) => {
    const item = element("li"), made = element("button", "", "row");
    made.type = "button";
    made.append(element("b", session.name), element("small", state(session)));
    made.addEventListener("click", () => showOpen(session.id));
    item.append(made);
    return item;
  }));
  const found = await trying(() => ask("/files"));
  if (!found) return;
  $("homefiles").replaceChildren(...found.files.map(({ file, changed_utc, size_bytes, picture }) => card(
    picture ? `${API}/files/${encodeURIComponent(file)}/picture?at=${encodeURIComponent(changed_utc)}` : null,
    file.replace(/\.rona$/, ""), `${when(changed_utc)} · ${megabytes(size_bytes)}`, () => openFile(file),
  )));
  $("homenone").hidden = found.files.length > 0;
  await devices();
}

const KINDS = { VIRTUAL: "simulated", REPLAY: "played back from a recording", REAL: "connected hardware" };

async function devices() {
  const session = program.state?.session;
  const rows = [["Tracker", "–"], ["Robot", "–"], ["Probe", "–"]];
  let words = "Devices belong to a session: open one.";
  if (session && program.state.origin) {
    const held = (await trying(() => ask(`/sessions/${session.id}`)))?.setup;
    const { origin } = program.state;
    words = `${origin}: ${KINDS[origin] ?? ""}, of “${session.name}”.`;
    if (held) {
      rows[0][1] = `${held.titles.Tracker}, ${held.devices.tracker.rate_hz} Hz`;
      rows[1][1] = held.titles.Robot;
      rows[2][1] = held.titles.Probe;
    }
  } else if (session) {
    words = "The devices of the open session could not be built: see step 1.";
  }
  $("homedevices").textContent = words;
  $("homedevicelist").replaceChildren(...rows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}

for (const [id, act] of [["homenew", openNew], ["homedemo", openDemo]]) $(id).addEventListener("click", () => trying(act));
$("homeopenfile").addEventListener("click", () => $("homefile").click());
$("homefile").addEventListener("change", () => {
  const [file] = $("homefile").files;
  $("homefile").value = "";
  if (file) trying(() => openUpload(file));
});

let seen = "";
follow("status", (now) => {
  const text = JSON.stringify([now.sessions, now.origin]);
  if (text === seen || document.body.dataset.view !== "home") return;
  seen = text;
  refresh();
});
follow("shown", (name) => { seen = ""; if (name === "home") refresh(); });
