// Tabs of the docks that are open: the server builds and draws what they show.

import { follow } from "./base.js";
import { act } from "./link.js";

let told = "";

follow("linked", () => { told = ""; });
follow("drawn", (page) => {
  if (!page?.querySelector("[data-page]")) return; // nobody listens yet
  const tabs = [...page.querySelectorAll("[data-dock-strip] [data-dock-tab][aria-selected=true]")];
  const open = tabs.map((tab) => tab.textContent.trim()).filter((name) => name !== "Replay").sort();
  if (!open.length || open.join() === told) return;
  told = open.join();
  act("tabs", open);
});
