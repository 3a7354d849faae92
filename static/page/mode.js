// What a click on the skull does now: told over the scene, by the cursor and by the button pressed.

import { $, follow } from "./base.js";
import { inside, link, listen, viewer } from "./link.js";

const LOOK_MS = 100; // how often the outline is looked for, at most
let looked = 0;

function show(view) {
  $("mode").hidden = !view.mode;
  $("modewords").textContent = view.mode;
  inside()?.documentElement.toggleAttribute("data-mode", Boolean(view.mode));
}

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
  viewer.contentWindow.__viserMutable?.nodeRefFromName?.["/skull"]?.traverse((part) => {
    const settings = part.material?.uniforms;
    if (settings?.screenspace && settings.thickness) settings.opacity.value = 0;
  });
}

follow("view", show);
follow("drawn", press);
listen("pointermove", quiet);
