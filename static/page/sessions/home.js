// Start page: new, open, demo, recent files with their pictures.

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
  const text = JSON.stringify(now.sessions);
  if (text === seen || document.body.dataset.view !== "home") return;
  seen = text;
  refresh();
});
follow("shown", (name) => { seen = ""; if (name === "home") refresh(); });
