"use strict";
// Fields of the docks: what is typed counts once Enter is pressed or the field is left, as a whole.
// The viewer sends the server every key. Here the typing is kept from it; the finished text goes
// to the server, which reads it and writes the field, or says why not: see rona_ui/fields.py.

const TYPED = ".mantine-NumberInput-input, .mantine-TextInput-input";
const CONTROLS = ".mantine-NumberInput-controls";

class FieldKeeper {
  constructor(page) {
    this.page = page; // window of the viewer
    this.draft = null; // the field that is being typed into, and its name
    this.sent = 0;
    this.native = Object.getOwnPropertyDescriptor(page.HTMLInputElement.prototype, "value");
    const on = (kind, act) => page.addEventListener(kind, act, true);
    on("input", (event) => this.begin(event));
    const typing = (event) => this.draft !== null && event.target === this.draft.field;
    for (const kind of ["input", "change"]) {
      on(kind, (event) => { if (typing(event)) event.stopImmediatePropagation(); });
    }
    on("focusout", (event) => { if (typing(event)) this.finish(); });
    on("keydown", (event) => this.onKey(event));
    for (const kind of ["pointerdown", "mousedown"]) on(kind, (event) => this.onPress(event));
  }

  begin(event) {
    const field = event.target;
    if (this.draft?.field === field || !field.matches?.(TYPED)) return;
    if (!event.isTrusted) return; // it was not typed
    const mail = this.page.document.querySelector("[data-typed]")?.dataset.typed;
    const box = this.labelled(field);
    if (!mail || !box || !this.page.__viserMutable?.sendMessage) return; // not one of the docks
    this.finish();
    const draft = {
      field, mail,
      name: box.querySelector("label[for]").htmlFor,
      part: [...box.querySelectorAll(TYPED)].indexOf(field),
      inner: Object.getOwnPropertyDescriptor(field, "value"), // the viewer watches it there
      watch: new this.page.MutationObserver(() => { if (field.disabled) this.finish(); }),
    };
    // What the viewer writes meanwhile must not mix with what is being typed.
    Object.defineProperty(field, "value", {
      configurable: true,
      get: () => this.native.get.call(field),
      set: () => {},
    });
    draft.watch.observe(field, { attributes: true, attributeFilter: ["disabled"] });
    this.draft = draft;
  }

  // The least box round a field that holds its label too; the label knows the name of the field.
  labelled(field) {
    let box = field.parentElement;
    while (box && !box.querySelector("label[for]")) box = box.parentElement;
    return box && box.querySelectorAll("label[for]").length === 1 ? box : null;
  }

  // What the viewer last drew: React keeps it as the value that the field began with.
  drawn() { return this.draft.field.defaultValue; }

  // Show again what the viewer believes is there; return what was typed in its place.
  release() {
    const { field, inner, watch } = this.draft, drawn = this.drawn();
    watch.disconnect();
    this.draft = null;
    const text = this.native.get.call(field);
    delete field.value;
    if (inner) Object.defineProperty(field, "value", inner);
    field.value = drawn;
    return text;
  }

  finish() {
    if (!this.draft) return;
    const { mail, name, part } = this.draft, drawn = this.drawn();
    const text = this.release();
    if (text === drawn) return;
    const value = JSON.stringify({ field: name, part, text, number: ++this.sent });
    this.page.__viserMutable.sendMessage({ type: "GuiUpdateMessage", uuid: mail, updates: { value } });
  }

  onKey(event) {
    if (!this.draft || event.target !== this.draft.field || event.isComposing) return;
    const step = event.key === "ArrowUp" || event.key === "ArrowDown";
    if (step && this.draft.field.matches(".mantine-TextInput-input")) return;
    if (event.key === "Enter" || step) this.finish();
    // The first press of an arrow takes what was typed; it does not step from what was there before.
    if (step) { event.preventDefault(); event.stopImmediatePropagation(); }
  }

  // The arrows beside a number, likewise; the field keeps the focus when they are pressed.
  onPress(event) {
    const controls = event.target.closest?.(CONTROLS);
    if (event.type === "pointerdown") {
      this.pressed = Boolean(this.draft && controls && this.labelled(this.draft.field)?.contains(controls));
      if (this.pressed) this.finish();
    }
    if (this.pressed && controls) { event.preventDefault(); event.stopImmediatePropagation(); }
  }

  // Take back what is being typed; return whether there was anything.
  drop() {
    if (!this.draft) return false;
    this.release();
    return true;
  }
}
