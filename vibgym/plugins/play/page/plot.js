// The errors of the last ten seconds: distance in mm on the left, heading in degrees on the right.

const SPAN = 10; // s

export class Plot {
  constructor(canvas) {
    this.canvas = canvas;
    this.clear();
  }

  clear() {
    this.points = []; // [s, mm, deg]
    this.time = 0;
    this.due = true;
  }

  add(seconds, [mm, deg]) {
    this.time += seconds;
    this.points.push([this.time, mm, deg]);
    while (this.points[0][0] < this.time - SPAN) this.points.shift();
    this.due = true;
  }

  draw() {
    if (!this.due) return;
    this.due = false;
    const { canvas } = this, ratio = Math.min(2, window.devicePixelRatio || 1), style = getComputedStyle(canvas);
    const wide = canvas.clientWidth, high = canvas.clientHeight;
    if (canvas.width !== Math.round(wide * ratio)) canvas.width = Math.round(wide * ratio);
    if (canvas.height !== Math.round(high * ratio)) canvas.height = Math.round(high * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, wide, high);
    context.font = "12px system-ui, sans-serif";
    this.#curve(context, 1, style.getPropertyValue("--mm"), "mm", wide, high, "left");
    this.#curve(context, 2, style.getPropertyValue("--deg"), "°", wide, high, "right");
  }

  #curve(context, which, colour, unit, wide, high, side) {
    const known = this.points.filter((point) => point[which] !== null);
    if (!known.length) return;
    const most = Math.max(1e-3, ...known.map((point) => point[which]));
    const step = 10 ** Math.floor(Math.log10(most)), top = Math.ceil(most / step) * step;
    context.fillStyle = context.strokeStyle = colour;
    context.textAlign = side;
    const x = side === "left" ? 4 : wide - 4;
    context.fillText(`${+top.toPrecision(3)} ${unit}`, x, 13);
    context.fillText(`0`, x, high - 4);
    context.lineWidth = 1.6;
    context.beginPath();
    known.forEach((point, k) => {
      const u = 44 + ((point[0] - this.time) / SPAN + 1) * (wide - 88), v = high - 6 - (point[which] / top) * (high - 24);
      context[k ? "lineTo" : "moveTo"](u, v);
    });
    context.stroke();
  }
}
