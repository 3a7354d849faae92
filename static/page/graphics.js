// Graphics of the scene: the browser may take them away (driver restarted, memory short, long sleep).
// The picture then stands still or is empty, while all else goes on: that is said, with a way out.

import { $, follow } from "./base.js";
import { link, viewer } from "./link.js";

const LOOK_MS = 1000;

function lost() {
  const canvas = viewer.contentWindow?.__viserMutable?.canvas;
  return canvas?.isConnected && canvas.getContext("webgl2")?.isContextLost() === true;
}

function look() {
  const now = lost();
  if (now === !$("graphicslost").hidden) return;
  $("graphicslost").hidden = !now; // the browser may give them back, and the viewer then draws anew
}

// Loads the viewer alone; the server has it go on at its step, with its layers and cut.
$("graphicsreload").addEventListener("click", () => {
  link.fields?.finish(); // what is being typed counts
  viewer.contentWindow.location.reload();
});
follow("entered", look);
setInterval(look, LOOK_MS);
