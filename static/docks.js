"use strict";
// What the docks of the viewer lack: hints on buttons and labels, tabs that follow the step, roles,
// and that one of them folds where there is no room for both.
// The server writes both into the page as hidden elements, see rona_ui/viewer/fields.py and
// rona_ui/panels/layout/docks.py.

const HINTS_MS = 300; // how often the hints are written anew, at most
const TRY_MS = 150, MOST_TRIES = 40;
const STEP_BUTTON = ".r-step";
const ROOM_PX = 1150; // less wide, both docks would leave the scene too little
const EDGES = ["left", "right"];

class DockHelper {
  constructor(page) {
    this.page = page; // window of the viewer
    this.hinted = -Infinity;
    this.followed = ""; // step
    this.wanted = []; // names of tabs that are still to be opened
    this.alone = "right"; // the dock that folds when the other one opens and there is no room
    this.folded = null; // the one that was folded for that
    for (const kind of ["pointerover", "focusin"]) {
      page.addEventListener(kind, () => this.hint(), true);
    }
    page.addEventListener("pointerdown", (event) => this.choose(event), true);
    new page.MutationObserver(() => this.look()).observe(
      page.document.documentElement, { childList: true, subtree: true });
    page.addEventListener("resize", () => this.fit());
    this.look();
  }

  look() {
    this.follow();
    this.part();
    this.fit();
  }

  // Where there is no room, opening one dock folds the other; with room again, that one comes back.
  fit() {
    const inside = this.page.document;
    const fold = (edge) => inside.querySelector(`[data-dock-region-collapse="${edge}"]`);
    const open = EDGES.filter((edge) => fold(edge));
    if (this.page.innerWidth < ROOM_PX) {
      if (open.length === 1) this.alone = open[0];
      if (open.length < 2) return;
      this.folded = this.alone;
      fold(this.folded).click();
    } else if (this.folded) {
      const edge = this.folded;
      this.folded = null;
      this.alone = "right";
      if (open.includes(edge)) return;
      inside.querySelector(`[data-dock-region="${edge}"] [data-dock-minimize-all]`)?.click();
      this.followed = ""; // its tabs have not followed meanwhile
    }
  }

  // Hints as titles: the viewer shows none on its buttons, and those of fields beside the label only.
  hint() {
    const left = this.hinted + HINTS_MS - performance.now(), inside = this.page.document;
    clearTimeout(this.later);
    if (left > 0) { // a pointer that rests from now on counts, too
      this.later = setTimeout(() => this.hint(), left);
      return;
    }
    this.hinted = performance.now();
    for (const hint of inside.querySelectorAll("[data-hint-for]")) {
      const control = inside.getElementById(hint.dataset.hintFor);
      const label = inside.querySelector(`label[for="${CSS.escape(hint.dataset.hintFor)}"]`);
      for (const shown of [control?.matches("button") ? control : null, label]) {
        if (shown && shown.title !== hint.textContent) shown.title = hint.textContent;
      }
    }
    for (const row of inside.querySelectorAll(STEP_BUTTON)) { // a see-through button lies over it
      const button = row.parentElement.nextElementSibling?.querySelector("button");
      if (button && button.title !== row.title) button.title = row.title;
    }
  }

  // The tabs that go with a step are opened once, when the step is; then they are the surgeon's.
  follow() {
    const wish = this.page.document.querySelector("[data-step-tabs]");
    if (!wish || wish.dataset.step === this.followed) return;
    this.followed = wish.dataset.step;
    this.wanted = wish.dataset.stepTabs.split(",");
    this.tries = 0;
    clearTimeout(this.timer);
    this.open();
  }

  // A list of tabs may hold tabs alone, and the bar of a folded dock holds a button beside them.
  part() {
    for (const bar of this.page.document.querySelectorAll("[data-dock-bar][role=tablist]")) {
      if (!bar.querySelector(":scope > [role=button]")) continue;
      bar.setAttribute("role", "group");
      bar.removeAttribute("aria-orientation");
      bar.firstElementChild.setAttribute("role", "tablist");
    }
  }

  // Until they are open: the docks may not have been drawn yet.
  open() {
    const tabs = [...this.page.document.querySelectorAll("[data-dock-strip] [data-dock-tab]")];
    const found = this.wanted.map((name) => tabs.find((tab) => tab.textContent.trim() === name));
    const closed = found.filter((tab) => tab?.getAttribute("aria-selected") !== "true");
    if (!closed.length || ++this.tries > MOST_TRIES) {
      this.wanted = [];
      return;
    }
    for (const tab of closed) {
      tab?.dispatchEvent(new this.page.KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
    }
    this.timer = setTimeout(() => this.open(), TRY_MS);
  }

  // A tab may be chosen meanwhile.
  choose(event) {
    if (!event.target.closest?.("[data-dock-tab]")) return;
    clearTimeout(this.timer);
    this.wanted = [];
  }
}

{
  const frame = document.getElementById("viewer");
  let helped = null; // the document that is looked after
  const help = () => {
    const inside = frame.contentDocument;
    if (!inside?.body || inside === helped || inside.URL === "about:blank") return; // its load comes yet
    helped = inside;
    new DockHelper(frame.contentWindow);
  };
  frame.addEventListener("load", help);
  help();
}
