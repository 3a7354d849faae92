// Tabs of the docks that are open: the server builds and draws what they show.

import { follow } from "./base.js";
import { act } from "./link.js";

let sent = "";

follow("linked", () => { sent = ""; });
follow("drawn", (page) => {
  if (!page?.querySelector("[data-page]")) return; // not ready yet
  const tabs = [...page.querySelectorAll("[data-dock-strip] [data-dock-tab][aria-selected=true]")];
  const open = tabs.map((tab) => tab.textContent.trim()).filter((name) => name !== "Replay").sort();
  if (!open.length || open.join() === sent) return;
  sent = open.join();
  act("tabs", open);
});
