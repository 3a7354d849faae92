// Look of the page: light or dark, and a cover until the first picture is there.

import { $, follow } from "./base.js";
import { register } from "./commands/commands.js";
import { act, inside, link, viewer } from "./link.js";

// ---------------------------------------------------------------- light and dark

const system = matchMedia("(prefers-color-scheme: dark)");
const BEGINS = "light"; // the viewer's look, until it is asked for another
const chosen = () => localStorage.getItem("theme") ?? (system.matches ? "dark" : "light");

function dress() {
  const theme = chosen();
  document.documentElement.dataset.theme = theme;
  const page = inside()?.documentElement;
  if (!page || !link.view) return;
  if ((page.dataset.theme ?? BEGINS) !== theme) act("theme", theme);
  page.dataset.theme = theme;
}

function turn() {
  localStorage.setItem("theme", chosen() === "dark" ? "light" : "dark");
  dress();
}

system.addEventListener("change", dress);
register({ id: "theme", group: "Page", title: "Dark mode", icon: "theme", everywhere: true,
  label: () => (chosen() === "dark" ? "Light mode" : "Dark mode"), run: turn });
dress();

// ---------------------------------------------------------------- what developers see

const developer = new URLSearchParams(location.search).has("dev");
follow("entered", (page) => { page.documentElement.toggleAttribute("data-dev", developer); });

// ---------------------------------------------------------------- the cover

const LOOK_MS = 30;
const PATIENCE_MS = 15000; // then the docks are shown, whatever the scene does
// Beneath the cover the scene has its place between the docks from the start: the viewer would draw
// it large, small, large and small again, a second each where software stands in for a graphics card.
const LEFT_PX = 344, RIGHT_PX = 384; // widths in rona_ui/panels/layout/docks.py, with their edges
const HELD = `div:has(> div > div > div > canvas:not(.uplot *)) { inset: 0 ${RIGHT_PX}px 0 ${LEFT_PX}px !important; }`;
let since = 0;
let held = null;

function uncover() {
  const page = inside(), drawn = viewer.contentWindow.__viserSceneTree?.getState();
  const dressed = page?.querySelector("[data-page]") && page.querySelector(".r-step");
  const there = link.view?.ready && drawn && "/skull" in drawn;
  if (!dressed || (!there && performance.now() - since < PATIENCE_MS)) return;
  dress();
  held?.remove(); // the docks are there and say the same, unless one was folded
  const frame = viewer.contentWindow.requestAnimationFrame.bind(viewer.contentWindow);
  frame(() => frame(() => { $("splash").hidden = true; })); // the picture is on the screen
}

function cover() {
  since = performance.now();
  held = inside().createElement("style");
  held.textContent = HELD;
  inside().head.append(held);
  $("splash").hidden = false;
  const timer = setInterval(() => { if ($("splash").hidden) clearInterval(timer); else uncover(); }, LOOK_MS);
}

follow("entered", cover);
follow("view", dress);
