// The page: tool bar, start page, keys; the viewer is in its frame.

import "./stop.js";
import "./commands/menus.js";
import "./status.js";
import "./sessions/sessions.js";
import "./commands/palette.js";
import "./commands/help.js";
import "./look.js";
import "./mode.js";
import "./tabs.js";
import "./graphics.js";
import "./sessions/home.js";
import "./sessions/guide.js";
import "./sessions/recover.js";
import "./commands/tools.js";
import "./commands/keys.js";
import "./access.js";
import { begin } from "./link.js";
import { watch } from "./status.js";
import { beginView } from "./views.js";

beginView();
begin();
watch();
