// What a click on the skull does now: shown over the scene, by the cursor and by the button pressed;
// and the arrow keys, where they move something.

import { $, follow } from "./base.js";
import { typing } from "./commands/keys.js";
import { act, inside, link, listen, viewer } from "./link.js";

const LOOK_MS = 100; // how often the outline is looked for, at most
let looked = 0;

function show(view) {
  $("mode").hidden = !view.mode;
  $("modewords").textContent = view.mode;
  inside()?.documentElement.toggleAttribute("data-mode", Boolean(view.mode));
  aim();
}

// ---------------------------------------------------------------- footprint of probe or brush

const MOST_PX = 120; // browsers show no larger cursor
const SETTLED_MS = 500; // the camera has come to rest after a turn of the wheel

// Pixels that a millimetre takes across the view at a place of the scene (mm).
function pixelsPerMm(place) {
  const scene = viewer.contentWindow.__viserMutable, skull = scene?.nodeRefFromName?.["/skull"];
  if (!skull || !scene.camera || !scene.canvas) return 0;
  const at = skull.position.clone().set(...place.map((mm) => mm / 1000)).applyMatrix4(skull.parent.matrixWorld);
  const depth = -at.applyMatrix4(scene.camera.matrixWorldInverse).z;
  return scene.canvas.clientHeight / 2000 * scene.camera.projectionMatrix.elements[5] / depth;
}

function ring(width) {
  const size = Math.ceil(width) + 4, half = size / 2;
  const circle = (color, thick) => `<circle cx="${half}" cy="${half}" r="${width / 2}" fill="none" stroke="${color}" stroke-width="${thick}"/>`;
  const dot = `<circle cx="${half}" cy="${half}" r="1.5" fill="#1b2836"/>`;
  const drawn = circle("#fff", 3) + circle("#1b2836", 1.2) + dot;
  const image = `<svg xmlns="http://www.w3.org/2000/svg" width="${size}" height="${size}">${drawn}</svg>`;
  return `url("data:image/svg+xml,${encodeURIComponent(image)}") ${Math.round(half)} ${Math.round(half)}, crosshair`;
}

// The cursor is as wide as what it stands for, at the distance of the region.
function aim() {
  const wide = link.view?.footprint, style = inside()?.documentElement?.style;
  if (!style) return;
  const width = wide ? wide.width_mm * pixelsPerMm(wide.place_mm) : 0;
  const fits = width > 4 && width < MOST_PX;
  const wanted = fits ? ring(Math.round(width)) : "crosshair";
  if (style.getPropertyValue("--r-cursor") !== wanted) style.setProperty("--r-cursor", wanted);
}

// ---------------------------------------------------------------- arrow keys move a held point

const ARROWS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down" };

function nudge(event) {
  const way = ARROWS[event.key];
  if (!way || !link.view?.nudges || event.ctrlKey || event.altKey || event.metaKey) return;
  if (typing(event.target) || document.querySelector("dialog[open]")) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  act("nudge", event.shiftKey ? `fine ${way}` : way);
}

listen("keydown", nudge);

// ---------------------------------------------------------------- pressed button, quiet outline

// The button of the mode, among those of its group: the viewer shows none as pressed.
function press() {
  const words = link.view?.pressed ?? "";
  for (const button of inside().querySelectorAll("button[aria-pressed]")) {
    if (button.textContent.trim() !== words) button.removeAttribute("aria-pressed");
  }
  if (!words) return;
  for (const button of inside().querySelectorAll(".mantine-Button-root:not([aria-pressed])")) {
    if (button.textContent.trim() === words) button.setAttribute("aria-pressed", "true");
  }
}

// The viewer outlines what can be clicked: round a whole skull that says nothing and hides the bone.
function quiet() {
  const now = performance.now();
  if (!link.view?.mode || now - looked < LOOK_MS) return;
  looked = now;
  aim(); // the camera may have moved
  viewer.contentWindow.__viserMutable?.nodeRefFromName?.["/skull"]?.traverse((part) => {
    const settings = part.material?.uniforms;
    if (settings?.screenspace && settings.thickness) settings.opacity.value = 0;
  });
}

follow("view", show);
follow("drawn", press);
listen("pointermove", quiet);
listen("wheel", () => { if (link.view?.footprint) setTimeout(aim, SETTLED_MS); });
