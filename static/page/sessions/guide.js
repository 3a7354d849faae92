// Guided demo: the whole procedure on a virtual patient, one stage after the other, with captions.

import { $, API, ask, program, say, send, trying } from "../base.js";
import { register } from "../commands/commands.js";
import { docked, link } from "../link.js";
import { leaveFor } from "./sessions.js";
import { onEscape } from "../stop.js";

const READ_MS = 3500, LOOK_MS = 250;
const NAME = "Guided demo";
const CAPTIONS = {
  StartToolCapture: "The robot pivots its tool about the tip and moves it along the axes while the tracker watches. So robot and tracker learn where the other one is.",
  StartPointerCapture: "The hand-held pointer is pivoted about its tip: where the tip is, seen from its markers.",
  StartSurfaceCapture: "The pointer slides over the skull. Its tip samples the surface as a cloud of points.",
  StartPathCapture: "The surgeon shows with the pointer where the probe is to scan.",
  SmoothScanPath: "Fewer points follow the same line within a tolerance. The surface under each gives the direction of the probe: a 5D path.",
  StartRollSearch: "The roll about the probe axis is free. All angles are tried; the best one that the robot can traverse is timed, and a verifier that knows no planner certifies the motion.",
  StartProbeMountingCapture: "The probe touches a steel gauge plate, so that it is known how it sits in its holder.",
  StartScan: "The robot slides the probe over the bone under force control and takes an A-scan every few tenths of a millimetre.",
  StartMapping: "Echoes become maps of the outer and the inner boundary, fused with the pointer's points, each with its error.",
  StartTiltPlan: "Where the inner table is inclined, its echo misses an upright probe. The path is planned again with the probe tilted in four directions.",
  StartTiltScan: "The robot scans the next tilted pass. What several passes agree on is mapped.",
  StartCaliperMeasurements: "A caliper at a few places measures how fast sound runs in this bone.",
  StartBurrCapture: "The robot holds the spindle now and turns it about a pin whose point rests in a fixed seat. The deflection of the arm shows where the tip of the burr really is.",
  StartBedSearch: "Where does an implant leave enough bone below it, and how surely? Every place and turn is tried against the maps as they may be.",
  PlanMilling: "The bed is milled in layers along concentric rings. The roll about the burr, the timing and the collisions are found as for the scan; without a certificate nothing moves.",
  RehearseMilling: "The milling is rehearsed in the true virtual bone. The floor is scanned before the last layers, the depth is put right, and the force stops the burr should it break through.",
};

let tour = null; // the one that plays: session, paused, whether it has ended

const still = (mine) => tour === mine;
const sleep = (ms) => new Promise((done) => { setTimeout(done, ms); });

function caption(words, step = "") {
  $("guidestep").textContent = step;
  $("guidewords").textContent = words;
}

function close() {
  const was = tour !== null;
  tour = null;
  $("guide").hidden = true;
  return was;
}

// Wait long enough to read the caption, and for as long as it is paused.
async function read(mine) {
  for (let waited = 0; still(mine) && (mine.paused || waited < READ_MS); await sleep(LOOK_MS)) {
    if (!mine.paused) waited += LOOK_MS;
  }
}

async function ready(mine) {
  while (still(mine) && !(link.view?.session === mine.session && link.view.ready)) await sleep(LOOK_MS);
}

// Send one message with its fields; throw where it is refused or fails.
async function carryOut(mine, { kind, name, arguments: fields }) {
  const sent = await (await send("POST", `/sessions/${mine.session}/${kind}/${name}`, fields)).json();
  if (kind === "commands") return;
  for (let job = sent; still(mine); await sleep(LOOK_MS)) {
    job = await ask(`/jobs/${job.id}`);
    if (job.state === "failed") throw new Error(job.error);
    if (job.state === "cancelled") throw new Error("it was stopped");
    if (job.finished) return;
  }
}

// The stage to be done now; null where all are. Those in `left` are passed over.
const nextOf = (mine, left) => ask(`/sessions/${mine.session}/next?${left.map((name) => `skip=${name}`).join("&")}`);

async function play(mine) {
  await ready(mine);
  const stages = (await ask(`/sessions/${mine.session}/procedure`)).map((stage) => stage.name);
  const left = []; // offered stages that failed
  for (let stage = await nextOf(mine, left); stage && still(mine); stage = await nextOf(mine, left)) {
    docked(stage.step)?.click();
    const title = docked(stage.step)?.textContent.replace(/^Step \d+: /, "") ?? stage.title;
    const place = `${stages.indexOf(stage.name) + 1} of ${stages.length} · ${title}`;
    caption(CAPTIONS[stage.message?.name] ?? stage.reason, place);
    await read(mine);
    if (!still(mine)) return;
    const reason = await attempt(mine, stage, left);
    if (!still(mine)) return;
    if (reason === null) continue;
    if (!stage.offered) return end(`The demo ends here: ${reason}. All that was done is kept.`, false);
    left.push(stage.name);
    caption(`This part is left out: ${reason}`, place);
    await read(mine);
  }
  if (still(mine)) end("Done. The report holds maps, figures beside their limits and the certificate. Look round: every step stays open.", true);
}

// Carry out one stage; return why it is not done then, or null.
async function attempt(mine, stage, left) {
  if (!stage.message) return stage.reason;
  try {
    await carryOut(mine, stage.message);
  } catch (error) {
    return error.message;
  }
  const after = await nextOf(mine, left);
  return after?.name === stage.name ? after.reason : null;
}

function end(words, whole) {
  caption(words, whole ? "The whole procedure" : "");
  $("guidepause").hidden = true;
  $("guidereport").hidden = false;
  $("guideend").textContent = "Close";
}

async function begin() {
  let session = null;
  await leaveFor("start the guided demo", async () => {
    session = (await (await send("POST", "/sessions", { name: NAME })).json()).id;
  });
  if (!session) return; // a session stayed open
  tour = { session, paused: false };
  $("guidepause").hidden = false;
  $("guidepause").textContent = "Pause";
  $("guidereport").hidden = true;
  $("guideend").textContent = "End";
  caption("A virtual patient, robot, tracker and probe, with errors that the program does not know.", NAME);
  $("guide").hidden = false;
  const mine = tour;
  try {
    await play(mine);
  } catch (error) {
    if (still(mine)) end(`The demo ends here: ${error.message}.`, false);
  }
}

$("guidepause").addEventListener("click", () => {
  tour.paused = !tour.paused;
  $("guidepause").textContent = tour.paused ? "Go on" : "Pause";
});
$("guideend").addEventListener("click", () => {
  if (program.state?.jobs.length) say("The running step ends by itself, or by Stop");
  close();
});
$("guidereport").addEventListener("click", () => { window.open(`${API}/sessions/${tour.session}/report`, "_blank", "noopener"); });
$("homeguide").addEventListener("click", () => trying(begin));
register({ id: "guide", group: "Page", title: NAME, everywhere: true, run: begin });
onEscape(close);
