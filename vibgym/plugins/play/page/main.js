// Wires the page: what comes over the link goes to motion, plot and panel; hand and brush go over the link; a picture a frame.

import { Brush } from "./brush.js";
import { Hand } from "./hand.js";
import { Link } from "./link.js";
import { Motion } from "./motion.js";
import { Panel } from "./panel.js";
import { Plot } from "./plot.js";
import { drawSide } from "./side.js";
import { Table, bytes } from "./table.js";

const $ = (id) => document.getElementById(id);
const canvas = $("table"), table = new Table(canvas), motion = new Motion(), plot = new Plot($("plot"));
const send = (what) => link.send(what);
const hand = new Hand(table, send), brush = new Brush(table, send);
let tool = hand, pointer = null, jump = null;
const panel = new Panel(send, (name) => {
  tool = name === "brush" ? brush : hand;
  canvas.classList.toggle("brush", tool === brush);
});

// What benchmarks and tests read: pictures drawn, and ms from the mouse's last move to the picture that shows it.
const figures = (window.vibgym = { pictures: 0, delays: [], table, motion });

const KINDS = {
  scene(scene) {
    table.setScene(scene);
    panel.scene(scene);
    $("side").hidden = !scene.side;
    hand.chosen = null;
  },
  frame(frame) {
    const scale = ([x, y, heading]) => [x / 1e5, y / 1e5, heading / 1e4];
    frame.pose = frame.pose.map(scale);
    frame.goal = frame.goal ? frame.goal.map(scale) : null;
    frame.field = bytes(frame.field);
    motion.take(frame, (1000 * table.scene.stepTime) / frame.speed, performance.now());
    if (jump !== frame.jump) plot.clear();
    jump = frame.jump;
    if (frame.running) plot.add(table.scene.stepTime, frame.error);
    panel.frame(frame);
    if (table.scene.side) drawSide($("side"), table.scene, frame);
  },
  refused: ({ text }) => panel.refused(text),
  note: ({ text }) => panel.refused(text),
  kept: (message) => panel.kept(message),
  start: ({ code }) => panel.start(code),
};
const link = new Link((message) => KINDS[message.kind](message), (text, bad) => panel.state(text, bad));
figures.link = link;

function view(now) {
  const { frame } = motion;
  return { ...frame, pose: motion.poses(now), goal: motion.goals(now) };
}

// A world that does not answer: at the first step of a kind of scene kernels are compiled, which takes a while.
const SLOW = 1500; // ms
let waiting = false;
function watch(now) {
  const slow = link.ready && motion.frame && motion.frame.running && now - motion.began > SLOW + motion.lasts;
  if (slow !== waiting) panel.state(slow ? "working (kernels are compiled the first time)" : "connected", false);
  waiting = slow;
}

function picture(now) {
  if (link.ready) watch(now);
  if (motion.frame && table.scene && motion.frame.pose.length === table.scene.outlines.length) {
    const seen = hand.over(view(now));
    seen.field = brush.over(seen.field, now);
    table.draw(seen);
    plot.draw();
    figures.pictures += 1;
    if (pointer !== null) {
      figures.delays.push(performance.now() - pointer);
      if (figures.delays.length > 2000) figures.delays.splice(0, 1000);
      pointer = null;
    }
  }
  requestAnimationFrame(picture);
}
requestAnimationFrame(picture);

const point = ({ offsetX, offsetY }) => table.from([offsetX, offsetY]);
canvas.addEventListener("pointerdown", (event) => {
  if (!motion.frame) return;
  canvas.setPointerCapture(event.pointerId);
  canvas.classList.add("busy");
  tool.down(point(event), view(performance.now()), event.shiftKey);
});
canvas.addEventListener("pointermove", (event) => {
  if (!motion.frame) return;
  if (hand.held || brush.last) pointer = event.timeStamp;
  tool.move(point(event));
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, () => {
    canvas.classList.remove("busy");
    tool.up();
  });
}
canvas.addEventListener("wheel", (event) => {
  if (!hand.held) return;
  event.preventDefault();
  hand.turn(-Math.sign(event.deltaY) * (Math.PI / 36));
}, { passive: false });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("keydown", (event) => {
  if (!motion.frame || event.ctrlKey || event.metaKey || event.altKey) return;
  const does = { " ": () => panel.toggle(), ".": () => send({ do: "steps" }), u: () => send({ do: "undo" }) }[event.key];
  if (does) does();
  else if (!hand.key(event, view(performance.now()))) return;
  event.preventDefault();
});
$("amplitude").addEventListener("input", () => {
  brush.share = +$("amplitude").value;
  $("share").textContent = `${Math.round(100 * brush.share)} %`;
});
$("width").addEventListener("change", () => (brush.width = +$("width").value));
$("erase").addEventListener("change", () => (brush.erase = $("erase").checked));
window.addEventListener("resize", () => table.resize());
window.addEventListener("dragover", (event) => event.preventDefault());
window.addEventListener("drop", async (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (!file) return;
  panel.refused(""); // the line of the file before
  if (file.size > 2e6) return panel.refused(`${file.name} is larger than 2 MB`);
  const bytes = new Uint8Array(await file.arrayBuffer());
  let text = "";
  for (let k = 0; k < bytes.length; k += 8192) text += String.fromCharCode(...bytes.subarray(k, k + 8192));
  link.send({ do: "drop", name: file.name, content: btoa(text), units: $("units").value || null });
});
