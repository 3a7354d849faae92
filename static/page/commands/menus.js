// Menus of the tool bar: a button that opens a list below it; Tab and arrows walk through it.

import { element } from "../base.js";
import { listen } from "../link.js";
import { onEscape } from "../stop.js";

let open = null;

export class Menu {
  // `fill(list)` puts the entries in whenever the menu opens, and again by `refill()`.
  constructor(button, fill) {
    this.button = button;
    this.fill = fill;
    this.list = element("div", "", "menu");
    this.list.id = `${button.id}menu`;
    this.list.hidden = true;
    button.after(this.list);
    button.setAttribute("aria-expanded", "false");
    button.setAttribute("aria-controls", this.list.id);
    button.addEventListener("click", () => (open === this ? close() : this.show()));
    this.list.addEventListener("keydown", (event) => this.walk(event));
  }

  show() {
    close();
    open = this;
    this.list.replaceChildren();
    this.fill(this.list);
    this.list.hidden = false;
    this.button.setAttribute("aria-expanded", "true");
    const box = this.button.getBoundingClientRect();
    this.list.style.left = `${Math.max(4, Math.min(box.left, innerWidth - this.list.offsetWidth - 8))}px`;
    this.list.querySelector("button:not([disabled]), input, a")?.focus();
  }

  refill() {
    if (open !== this) return;
    const held = document.activeElement?.dataset?.key;
    this.list.replaceChildren();
    this.fill(this.list);
    if (held) this.list.querySelector(`[data-key="${CSS.escape(held)}"]`)?.focus();
  }

  walk(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step || event.target.matches("input[type=range]")) return;
    const entries = [...this.list.querySelectorAll("button:not([disabled]), input, a")];
    const at = entries.indexOf(document.activeElement);
    entries[(at + step + entries.length) % entries.length]?.focus();
    event.preventDefault();
  }
}

// Close what is open; return whether anything was.
export function close() {
  if (!open) return false;
  const menu = open;
  open = null;
  const within = menu.list.contains(document.activeElement);
  menu.list.hidden = true;
  menu.button.setAttribute("aria-expanded", "false");
  if (within) menu.button.focus();
  return true;
}

export function heading(list, text) {
  list.append(element("h3", text));
}

export function line(list) {
  list.append(document.createElement("hr"));
}

// An entry that does something and closes the menu; `more` stands grey on its right.
export function entry(list, text, act, { more = "", on = null, disabled = false } = {}) {
  const made = element("button", "", "entry");
  made.type = "button";
  made.disabled = disabled;
  if (on !== null) made.append(element("i", on ? "●" : "", "mark"));
  if (on) made.setAttribute("aria-current", "true");
  made.append(element("span", text));
  if (more) made.append(element("small", more));
  made.addEventListener("click", () => { close(); act(); });
  list.append(made);
  return made;
}

// A box to tick; the menu stays open.
export function tick(list, text, checked, act, { more = "", disabled = false } = {}) {
  const made = element("label", "", "entry"), box = document.createElement("input");
  Object.assign(box, { type: "checkbox", checked, disabled });
  box.dataset.key = text;
  box.addEventListener("change", () => act(box.checked));
  made.append(box, element("span", text));
  if (more) made.append(element("small", more));
  list.append(made);
}

listen("pointerdown", (event) => {
  if (open && !open.list.contains(event.target) && !open.button.contains(event.target)) close();
});
onEscape(close);
