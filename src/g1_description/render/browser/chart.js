// --- the chart: times of findings and contacts, and a plot below ---------------------------

const MOST_ROWS = 10;
const COLOR = { failed: "#d64541", warning: "#e08a1e", line: "#1f6fb4", dim: "#5c6672" };
const [LEFT, RIGHT] = [58, 12];

const ticks = (low, high, most) => {
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((part) => part * power).find((size) => size >= rough * 0.999);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) found.push(n * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return found.map((value) => [value, value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1")]);
};

class Chart {
  constructor(canvas) {
    this.canvas = canvas;
    this.key = "";
  }

  /**
   * Take a motion, and what is plotted of it: position:COLUMN, velocity:COLUMN, line:ROW,
   * base:COORDINATE, speed:LINK.
   */
  take(motion, key) {
    const [kind, name] = key.split(":");
    const number = Number(name);
    this.key = key;
    this.bounds = [];
    const joint = motion.robot.joints[motion.joints[number]];
    if (kind === "line") {
      const line = motion.lines[number];
      this.times = motion.checked;
      this.values = decode(line.values, Float32Array);
      this.unit = line.unit;
      this.bounds = [0];
    } else if (kind === "base") {
      this.times = motion.times;
      this.values = motion.coordinate(name);
      this.unit = BASE.indexOf(name) < 3 ? "m" : "rad";
    } else if (kind === "speed") {
      this.times = motion.times;
      this.values = motion.speed(number);
      this.unit = "m/s";
    } else if (joint) {
      const which = kind === "velocity" ? 1 : 0;
      this.times = motion.times;
      this.values = Float32Array.from(motion.times, (time) => motion.joint(number, time)[which]);
      const limits = which ? [-joint.velocity, joint.velocity] : joint.limits;
      this.bounds = (which && joint.velocity === null ? [] : limits).filter((limit) => limit !== null);
      this.unit = (joint.slides ? "m" : "rad") + (which ? "/s" : "");
    } else {
      this.times = this.values = [];
      this.unit = "";
    }
  }

  x(time) {
    const { begin, end } = this.motion;
    return LEFT + ((time - begin) / (end - begin || 1)) * (this.width - LEFT - RIGHT);
  }

  timeAt(x) {
    const { begin, end } = this.motion;
    const fraction = (x - LEFT) / (this.width - LEFT - RIGHT);
    return begin + Math.min(Math.max(fraction, 0), 1) * (end - begin);
  }

  draw(motion, time) {
    this.motion = motion;
    const { canvas } = this;
    [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(this.width * ratio);
    canvas.height = Math.round(this.height * ratio);
    const g = canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.font = "11px system-ui, sans-serif";
    g.textBaseline = "middle";
    const top = this.rows(g, motion);
    this.plot(g, top + 8, this.height - 20, time);
    const x = this.x(time);
    g.strokeStyle = "#20262e";
    g.lineWidth = 1.5;
    g.beginPath();
    g.moveTo(x, 3);
    g.lineTo(x, this.height - 18);
    g.stroke();
    g.fillStyle = "#20262e";
    g.beginPath();
    g.arc(x, 5, 4, 0, 7);
    g.fill();
  }

  /** Draw a row per cause and contact; return their height. */
  rows(g, motion) {
    const size = this.height < 180 ? 5 : 7;
    const shown = motion.causes.slice(0, MOST_ROWS);
    let y = 6;
    const row = (intervals, color, name) => {
      g.fillStyle = "#e9edf2";
      g.fillRect(LEFT, y, this.width - LEFT - RIGHT, size);
      g.fillStyle = color;
      for (const [first, last] of intervals) {
        const width = Math.max(this.x(last) - this.x(first), 2.5);
        g.fillRect(Math.min(this.x(first), this.width - RIGHT - width), y, width, size);
      }
      g.fillStyle = COLOR.dim;
      g.textAlign = "right";
      if (name) g.fillText(name, LEFT - 6, y + size / 2 + 1);
      y += size + 2;
    };
    shown.forEach((cause, n) => row(cause.intervals, cause.failed ? COLOR.failed : COLOR.warning, n ? "" : "findings"));
    motion.contacts.slice(0, 4).forEach((contact, n) => row(contact.intervals, "#7fb8a4", n ? "" : "contacts"));
    return shown.length || motion.contacts.length ? y : 10;
  }

  plot(g, top, bottom, time) {
    g.textAlign = "center";
    g.fillStyle = COLOR.dim;
    g.lineWidth = 1;
    const { begin, end } = this.motion;
    for (const [value, text] of ticks(begin, end, Math.max(2, this.width / 90))) {
      g.strokeStyle = "#edf0f4";
      g.beginPath();
      g.moveTo(this.x(value), top);
      g.lineTo(this.x(value), bottom);
      g.stroke();
      g.fillText(text, this.x(value), this.height - 9);
    }
    let [low, high] = [Infinity, -Infinity];
    for (const value of this.values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (low > high) return;
    const own = high - low;
    for (const bound of this.bounds) { // limits near the line are shown with it
      if (bound > low - own && bound < high + own) [low, high] = [Math.min(low, bound), Math.max(high, bound)];
    }
    const room = Math.max(0.08 * (high - low), 0.005);
    [low, high] = [low - room, high + room];
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
    for (const cause of this.motion.causes.filter((one) => one.plot === this.key)) {
      g.fillStyle = cause.failed ? "#d6454130" : "#e08a1e30";
      for (const [first, last] of cause.intervals) {
        g.fillRect(this.x(first), top, Math.max(this.x(last) - this.x(first), 2.5), bottom - top);
      }
    }
    g.textAlign = "right";
    for (const [value, text] of ticks(low, high, Math.max(2, (bottom - top) / 26))) {
      g.strokeStyle = "#edf0f4";
      g.beginPath();
      g.moveTo(LEFT, y(value));
      g.lineTo(this.width - RIGHT, y(value));
      g.stroke();
      g.fillStyle = COLOR.dim;
      g.fillText(text, LEFT - 6, y(value));
    }
    g.strokeStyle = "#9aa5b3";
    g.setLineDash([5, 4]);
    for (const bound of this.bounds.filter((value) => value > low && value < high)) {
      g.beginPath();
      g.moveTo(LEFT, y(bound));
      g.lineTo(this.width - RIGHT, y(bound));
      g.stroke();
    }
    g.setLineDash([]);
    g.strokeStyle = COLOR.line;
    g.lineWidth = 1.6;
    g.beginPath();
    let pen = false;
    this.values.forEach((value, n) => {
      if (Number.isNaN(value)) pen = false;
      else if (pen) g.lineTo(this.x(this.times[n]), y(value));
      else {
        g.moveTo(this.x(this.times[n]), y(value));
        pen = true;
      }
    });
    g.stroke();
    const value = this.values[nearest(this.times, time)];
    if (value === undefined || Number.isNaN(value)) return;
    g.fillStyle = COLOR.line;
    g.beginPath();
    g.arc(this.x(time), y(value), 3.5, 0, 7);
    g.fill();
    const isRight = this.x(time) > this.width - 120;
    g.textAlign = isRight ? "right" : "left";
    const text = `${value.toFixed(Math.abs(value) < 100 ? 3 : 1)} ${this.unit}`;
    const x = this.x(time) + (isRight ? -9 : 9);
    const size = g.measureText(text).width;
    g.fillStyle = "#ffffffd8";
    g.fillRect(isRight ? x - size - 2 : x - 2, top, size + 4, 15);
    g.fillStyle = COLOR.line;
    g.fillText(text, x, top + 8);
  }
}
