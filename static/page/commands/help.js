// Help: the steps in short, and all keys as the commands have them.

import { $, element } from "../base.js";
import { all, label, register } from "./commands.js";
import { onEscape } from "../stop.js";

const box = $("helptext");
const OTHERS = [
  ["Esc", "stops the robot at once while it moves, from any field; at rest closes what is open, reverts a field, or exits drawing and editing"],
  ["Enter", "applies a field; so does leaving it"],
  ["Arrows", "move the selected point of the smoothed path over the bone, with Shift in small steps"],
  ["Tab", "goes to the next button, field or folder; Space opens a folder"],
];

function keys() {
  const rows = all().filter((command) => command.key && !command.shownOnly);
  const spell = (key) => key.split("+").flatMap((part, index) => (index ? [" ", element("kbd", part)] : [element("kbd", part)]));
  return [...OTHERS, ...rows.map((command) => [command.key, command.id === "start" ? command.title : label(command)])]
    .map(([key, words]) => {
      const row = element("div");
      const term = element("dt");
      term.append(...spell(key));
      row.append(term, element("dd", words));
      return row;
    });
}

function open() {
  $("helpkeys").replaceChildren(...keys());
  box.show(); // not modal: Stop stays in reach
  box.querySelector("form button").focus();
}

register({ id: "help", group: "Page", title: "Help and keys", key: "?", also: ["F1"], icon: "help", everywhere: true, run: open });
onEscape(() => { const was = box.open; box.close(); if (was) $("help").focus(); return was; });
