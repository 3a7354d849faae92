// Command palette: every command by its words.

import { $, element } from "../base.js";
import { all, enabled, label, register, run } from "./commands.js";
import { onEscape } from "../stop.js";
import { close } from "./menus.js";

const box = $("palettebox"), field = $("palettefield"), list = $("palettelist");
let from = null; // where the focus was
let chosen = 0, matches = [];

function score(text, wanted) {
  let at = 0;
  for (const word of wanted) {
    const found = text.indexOf(word);
    if (found < 0) return -1;
    at += found;
  }
  return at;
}

function search() {
  const wanted = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  const landing = document.body.dataset.view !== "session";
  matches = all()
    .filter((command) => !command.shownOnly && command.id !== "palette" && (!landing || command.everywhere))
    .map((command) => ({ command, at: score(`${command.group} ${label(command)}`.toLowerCase(), wanted) }))
    .filter(({ command, at }) => at >= 0 && (enabled(command) || wanted.length))
    .sort((a, b) => (wanted.length ? a.at - b.at : 0))
    .map(({ command }) => command);
  chosen = Math.max(0, matches.findIndex(enabled));
  draw();
}

function draw() {
  list.replaceChildren(...matches.map((command, index) => {
    const item = element("li", "", index === chosen ? "on" : "");
    item.id = `palette-${index}`;
    item.setAttribute("role", "option");
    item.setAttribute("aria-selected", String(index === chosen));
    if (!enabled(command)) item.setAttribute("aria-disabled", "true");
    item.append(element("small", command.group), element("span", label(command)));
    if (command.key) item.append(element("kbd", command.key));
    item.addEventListener("click", () => take(index));
    return item;
  }));
  if (!matches.length) list.append(element("li", "No such command", "none"));
  field.setAttribute("aria-activedescendant", matches.length ? `palette-${chosen}` : "");
  list.children[chosen]?.scrollIntoView({ block: "nearest" });
}

function take(index) {
  const command = matches[index];
  if (!command || !enabled(command)) return;
  leave();
  run(command);
}

function leave() {
  if (!box.open) return false;
  box.close();
  from?.focus?.();
  return true;
}

function open() {
  if (box.open) { leave(); return; }
  close();
  from = document.activeElement;
  field.value = "";
  box.show(); // not modal: Stop stays in reach
  field.focus();
  search();
}

field.addEventListener("input", search);
field.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (step && matches.length) {
    chosen = (chosen + step + matches.length) % matches.length;
    draw();
    event.preventDefault();
  } else if (event.key === "Enter") {
    take(chosen);
    event.preventDefault();
  }
});
box.addEventListener("focusout", (event) => { if (event.relatedTarget && !box.contains(event.relatedTarget)) box.close(); });

onEscape(leave);
register({ id: "palette", group: "Page", title: "Find a command", key: "Ctrl+K", also: ["Ctrl+Shift+P"], icon: "palette",
  anywhere: true, everywhere: true, run: open });
