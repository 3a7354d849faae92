// The tool bar: its buttons, and the menus of camera, cut and layers.

import { $, element, follow, program } from "../base.js";
import { enabled, find, label, run } from "./commands.js";
import { icon } from "./icons.js";
import { act, link } from "../link.js";
import { Menu, entry, heading, line, tick } from "./menus.js";

const PLAIN = ["undo", "redo", "save", "report", "figures", "screenshot", "palette", "theme", "help"];

function dress(made, name) {
  made.prepend(icon(name));
}

for (const id of PLAIN) {
  const made = $(id);
  dress(made, id);
  made.addEventListener("click", () => run(find(id)));
}
for (const id of ["camera", "cut", "layers"]) {
  dress($(id), id);
  $(id).append(icon("down", 14));
}
$("sessionbutton").append(icon("down", 14));

function refresh() {
  for (const id of PLAIN) {
    const command = find(id), made = $(id);
    made.disabled = !enabled(command);
    const keys = command.key ? ` (${command.key})` : "";
    made.title = label(command) + keys;
  }
  const view = link.view;
  $("cut").classList.toggle("used", Boolean(view) && view.cut !== "off");
  for (const id of ["camera", "cut", "layers"]) $(id).disabled = !view || !program.state?.session;
}

// ---------------------------------------------------------------- camera

const camera = new Menu($("camera"), (list) => {
  for (const name of link.view.cameras) {
    const command = find(`camera-${name}`);
    entry(list, name, () => run(command), { more: command.key ?? "" });
  }
});

// ---------------------------------------------------------------- cut

const CUTS = { off: "No cut", lengthwise: "Lengthwise", crosswise: "Crosswise" };
const KEY = [["#56b4e9", "outer boundary"], ["#e69f00", "inner boundary"], ["#d5c7a3", "bone between them, as mapped"]];

const cut = new Menu($("cut"), (list) => {
  const view = link.view, off = view.drawing;
  heading(list, "Cut the drawn skull, perpendicular to the region");
  for (const [name, words] of Object.entries(CUTS)) {
    const made = element("label", "", "entry"), choice = document.createElement("input");
    Object.assign(choice, { type: "radio", name: "cut", checked: view.cut === name, disabled: off });
    choice.dataset.key = name;
    choice.addEventListener("change", () => act("cut", name));
    made.append(choice, element("span", words));
    list.append(made);
  }
  if (off) list.append(element("p", "The skull is whole while you draw on it."));
  if (off || view.cut === "off") return;
  const reach = view.cut_reach, at = document.createElement("input"), output = element("output", offset(view.cut_offset));
  Object.assign(at, { type: "range", min: -reach, max: reach, step: 0.5, value: view.cut_offset });
  at.setAttribute("aria-label", "Cut offset from the centre of the region (mm)");
  at.dataset.key = "offset";
  at.addEventListener("input", () => { output.textContent = offset(Number(at.value)); act("cut_offset", Number(at.value)); });
  const row = element("div", "", "slide");
  row.append(element("span", "Offset"), at, output);
  list.append(row);
  tick(list, "Cut the maps too", view.cut_maps, (on) => act("cut_maps", on));
  const legend = element("p", "", "legend");
  for (const [color, words] of KEY) {
    const mark = document.createElement("i");
    mark.style.background = color;
    const part = element("span");
    part.append(mark, words);
    legend.append(part);
  }
  list.append(legend);
});

const offset = (mm) => `${mm.toFixed(1)} mm`;

// ---------------------------------------------------------------- layers

const layers = new Menu($("layers"), (list) => {
  const view = link.view;
  tick(list, "All layers", view.all_layers, (on) => act("all_layers", on), { more: "Y" });
  line(list);
  for (const { name, title, shown, needed } of view.layers) {
    tick(list, title, shown, (on) => act("layer", { name, shown: on }),
      { more: needed || view.all_layers ? "" : "not in this step" });
  }
});

let last = "";
follow("view", (view) => {
  refresh();
  camera.refill();
  layers.refill();
  const state = JSON.stringify([view.cut, view.cut_maps, view.drawing]); // a slider is ahead of what comes back
  if (state !== last) cut.refill();
  last = state;
});
follow("status", refresh);
follow("shown", refresh);
refresh();
