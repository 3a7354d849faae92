// Keyboard and screen readers in the viewer's docks: folders, names, and the focus of who works there.

import { follow } from "./base.js";
import { docked, inside, link, listen } from "./link.js";

const FOLDER = ".mantine-Paper-root>.mantine-Paper-root:first-child:has(+div+div)"; // its head; see docks.css
const INPUTS = "input:not([type=hidden]):not([type=file]), textarea, [role=slider], [role=progressbar]";

// ---------------------------------------------------------------- folders

function folders(page) {
  for (const head of page.querySelectorAll(FOLDER)) {
    const open = String(head.nextElementSibling.style.display !== "none" && head.nextElementSibling.offsetHeight > 0);
    if (!head.hasAttribute("role")) {
      head.tabIndex = 0;
      head.setAttribute("role", "button");
    }
    if (head.getAttribute("aria-expanded") !== open) head.setAttribute("aria-expanded", open);
  }
}

listen("keydown", (event) => {
  if ((event.key !== "Enter" && event.key !== " ") || event.ctrlKey || event.repeat) return;
  if (event.target.ownerDocument !== inside() || !event.target.matches?.(FOLDER)) return;
  event.preventDefault();
  event.target.click();
});

// ---------------------------------------------------------------- names

// The least box round a field that holds a label too has the words for it.
function words(field) {
  for (let box = field.parentElement; box && box.ownerDocument; box = box.parentElement) {
    const found = box.querySelectorAll("label[for]");
    if (found.length) return found.length === 1 ? found[0].textContent : null;
    if (box.matches("[role=tabpanel]")) return null;
  }
  return null;
}

function names(page) {
  for (const field of page.querySelectorAll(INPUTS)) {
    if (field.getAttribute("aria-label") || field.hasAttribute("aria-labelledby") || field.labels?.length) continue;
    const said = words(field) ?? (field.getAttribute("role") === "progressbar" ? "Progress of the job" : null);
    if (said) field.setAttribute("aria-label", said);
  }
  for (const close of page.querySelectorAll(".mantine-Notification-closeButton:not([aria-label])")) close.setAttribute("aria-label", "Close");
  for (const area of page.querySelectorAll(".mantine-ScrollArea-viewport:not([tabindex])")) area.tabIndex = 0; // the arrows scroll it
}

// ---------------------------------------------------------------- focus

// A button that goes while it has the focus (a job starts or ends) hands it to its neighbour.
let last = null, wasIn = false;

listen("focusin", (event) => {
  if (event.target.ownerDocument !== inside()) { wasIn = false; return; }
  last = event.target;
  wasIn = true;
});
listen("pointerdown", (event) => { if (event.target.ownerDocument === inside()) wasIn = false; });

function focus(page) {
  if (!last || !wasIn || (last.isConnected && !last.disabled)) return;
  if (page.activeElement && page.activeElement !== page.body) return;
  const next = ["cancel", "continue", "next", "start"].map(docked).find((found) => found && !found.disabled);
  if (next && link.view) next.focus({ preventScroll: true });
}

follow("drawn", (page) => { folders(page); names(page); focus(page); });
follow("entered", () => { last = null; });
