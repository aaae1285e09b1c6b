/* Films of a page: film.py says how one is packed; table.js and side.js of vibgym.plugins.play.drawing, which stand above, draw it. */
const MARGIN = 20, BELOW = 16, SIDE = 110; // pixels of the still picture
const REST = 48, PHASES = 32, LEVELS = 7, LAST_STAYS = 1500, JUMP = 6; // JUMP: elements that no part passes between two frames
const LENGTH = 1e-4, HEIGHT = 1e-5, ANGLE = Math.PI / 1800;

/* One number says that a value never changes. */
function summed(steps, frames, factor) {
  const found = new Float64Array(frames);
  for (let k = 0, whole = 0; k < frames; k++) {
    whole += k < steps.length ? steps[k] : 0;
    found[k] = factor * whole;
  }
  return found;
}

function series(lists, frames) {
  const found = [];
  for (let k = 0; k < lists.length; k += 3) {
    found.push([LENGTH, LENGTH, ANGLE].map((factor, axis) => summed(lists[k + axis], frames, factor)));
  }
  return found;
}

async function read(text) {
  const packed = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const film = JSON.parse(await new Response(plain).text());
  film.poses = series(film.poses, film.frames);
  film.goals = film.goals ? series(film.goals, film.frames) : null;
  return film;
}

const isThere = (film, part, frame) => film.there[part] === "" || film.there[part][frame] === "1";

/* Pose at a time in frames, between the two next to it; null in empty slots. */
function poseAt(film, lists, part, time) {
  const frame = Math.floor(time), next = Math.min(frame + 1, film.frames - 1);
  if (!isThere(film, part, frame)) return null;
  const [x, y] = lists[part], limit = JUMP * film.scene.size;
  const gone = Math.hypot(x[next] - x[frame], y[next] - y[frame]) > limit || !isThere(film, part, next);
  const share = gone ? 0 : time - frame;
  return lists[part].map((each) => each[frame] + share * (each[next] - each[frame]));
}

/* Where a part has been, oldest first; where it came anew its trail begins. */
function trailAt(film, part, time, now) {
  const last = Math.floor(time), first = Math.max(0, last - film.trail), [x, y] = film.poses[part], points = now ? [now] : [];
  for (let k = last; k >= first && isThere(film, part, k); k--) {
    if (k < last && Math.hypot(x[k + 1] - x[k], y[k + 1] - y[k]) > JUMP * film.scene.size) break;
    points.push([x[k], y[k]]);
  }
  return points.reverse();
}

/* Phasors of all elements in a frame, in 1/127 of full scale. */
function fieldAt(film, frame) {
  const found = new Int8Array(2 * film.field.length);
  film.field.forEach((codes, element) => {
    const code = codes.charCodeAt(codes.length > 1 ? frame : 0) - REST - 1;
    if (code < 0) return;
    const strength = (127 * (1 + Math.floor(code / PHASES))) / LEVELS, phase = ((code % PHASES) * 2 * Math.PI) / PHASES;
    found[2 * element] = Math.round(strength * Math.cos(phase));
    found[2 * element + 1] = Math.round(strength * Math.sin(phase));
  });
  return found;
}

function viewAt(film, time) {
  const frame = Math.floor(time), parts = film.scene.outlines.map((_, part) => part);
  const pose = parts.map((part) => poseAt(film, film.poses, part, time));
  if (film.shown !== frame) [film.shown, film.seen] = [frame, fieldAt(film, frame)];
  return {
    pose, field: film.seen, there: pose.map((each) => each !== null),
    goal: film.goals && parts.map((part) => poseAt(film, film.goals, part, time)),
    trails: parts.map((part) => trailAt(film, part, time, pose[part])),
  };
}

function sideAt(film, frame, there) {
  const [flat, bottoms] = film.sides[frame], plates = [];
  for (let k = 0; k < flat.length; k += 3) plates.push([LENGTH * flat[k], LENGTH * flat[k + 1], HEIGHT * flat[k + 2]]);
  const corners = (list) => list.length && list.flatMap((x, k) => (k % 2 ? [] : [[LENGTH * x, HEIGHT * list[k + 1]]]));
  return { plates, bottoms: bottoms.map(corners), there };
}

const name = (button, verb) => { button.firstElementChild.textContent = verb; };

function canvasFor(label) {
  const found = document.createElement("canvas");
  found.setAttribute("role", "img");
  found.setAttribute("aria-label", label);
  return found;
}

/* The still picture gives way to a canvas with the first frame that is asked for. */
function player(figure) {
  const [button, slider] = figure.querySelectorAll(".controls button, .controls input");
  const caption = figure.querySelector(".caption"), still = figure.querySelector("img");
  let film = null, table = null, side = null, time = 0, begun = null;

  async function ready() {
    if (film) return;
    film = await read(figure.dataset.film);
    slider.max = film.frames - 1;
    const canvas = canvasFor(still.alt), share = (still.clientWidth || still.width) / still.width;
    still.replaceWith(canvas);
    table = new Table(canvas, MARGIN * share, BELOW * share);
    table.setScene(film.scene);
    if (film.sides) {
      side = canvasFor(`${still.alt}, from the side`);
      side.style.height = `${SIDE}px`;
      canvas.after(side);
    }
    window.addEventListener("resize", () => {
      table.resize();
      show();
    });
  }

  function show() {
    const now = Math.min(time, film.frames - 1), frame = Math.floor(now), view = viewAt(film, now);
    table.draw(view);
    if (side) drawSide(side, film.scene, sideAt(film, frame, view.there), table.margin);
    slider.value = frame;
    slider.setAttribute("aria-valuetext", film.captions[frame].trim());
    caption.textContent = film.captions[frame];
  }

  function step(now) {
    if (begun === null) return;
    time = Math.max(0, now - begun) / film.interval; // a frame may carry a time from before the click
    if (time > film.frames - 1 + LAST_STAYS / film.interval) {
      begun = now;
      time = 0;
    }
    show();
    requestAnimationFrame(step);
  }

  function stop() {
    begun = null;
    name(button, "Play");
  }

  button.addEventListener("click", async () => {
    if (begun !== null) return stop();
    name(button, "Pause");
    await ready();
    if (time >= film.frames - 1) time = 0;
    begun = performance.now() - time * film.interval;
    requestAnimationFrame(step);
  });
  slider.addEventListener("input", async () => {
    stop();
    const wanted = Number(slider.value) / Number(slider.max);
    await ready();
    time = wanted * (film.frames - 1);
    show();
  });
}

document.documentElement.classList.add("plays");
document.querySelectorAll("figure[data-film]").forEach(player);
window.vibgymFilm = { read };
