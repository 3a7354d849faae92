// The page: tool bar, start page, keys; the viewer is in its frame.

import "./stop.js";
import "./menus.js";
import "./status.js";
import "./sessions.js";
import "./palette.js";
import "./help.js";
import "./look.js";
import "./home.js";
import "./guide.js";
import "./recover.js";
import "./tools.js";
import "./keys.js";
import "./access.js";
import { begin } from "./link.js";
import { watch } from "./status.js";
import { beginView } from "./views.js";

beginView();
begin();
watch();
