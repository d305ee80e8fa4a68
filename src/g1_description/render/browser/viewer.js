// --- the page ---------------------------------------------------------------------------

/** Make an element; names and texts of files only ever become text. */
const make = (tag, into, values = {}) => into.appendChild(Object.assign(document.createElement(tag), values));

const VIEWS = { Front: [0, 0.1], Side: [-Math.PI / 2, 0.1], Back: [Math.PI, 0.1] };
const BESIDE = [0, 1, 0]; // how far from its place the robot of before is drawn, in m
const SLOW = 60; // a frame that takes longer, in ms, is drawn coarser

class Viewer {
  constructor(robot) {
    this.robot = robot;
    this.root = document.createElement("main");
    this.root.id = "viewer";
    document.body.prepend(this.root);
    this.box = make("div", this.root, { id: "scene" });
    const canvas = make("canvas", this.box);
    const views = make("div", this.box, { className: "views" });
    const bar = make("div", this.root, { id: "bar" });
    this.playButton = make("button", bar, { id: "play", textContent: "▶", title: "Play or pause (space)" });
    this.speed = make("select", bar, { id: "speed", title: "Speed" });
    for (const speed of [0.1, 0.25, 0.5, 1, 2]) {
      make("option", this.speed, { value: speed, textContent: `${speed} ×`, selected: speed === 1 });
    }
    this.clock = make("span", bar, { id: "time" });
    this.what = make("select", bar, { id: "what", title: "Plot" });
    this.chart = new Chart(make("canvas", make("div", this.root, { id: "chart" })));
    this.time = 0;
    this.quality = 1;
    this.marks = [];
    try {
      this.scene = new Scene(canvas, robot);
    } catch (error) {
      make("p", this.box, { className: "why", textContent: error.message });
    }
    // A browser may take its memory away, such as from a page in the background.
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.scene = new Scene(canvas, robot);
      this.ask();
    });
    for (const [name, [yaw, pitch]] of Object.entries(VIEWS)) {
      make("button", views, { textContent: name, onclick: () => { this.frame(yaw, pitch); this.ask(); } });
    }
    this.forces = make("button", views, { id: "forces", textContent: "Forces", title: "Contact forces, and what is missing in red" });
    this.forces.onclick = () => { this.forces.classList.toggle("off"); this.ask(); };
    this.before = make("button", views, { id: "before", textContent: "Before", title: "The robot before the motion was changed, in grey" });
    this.before.onclick = () => { this.before.classList.toggle("off"); this.frame(); this.ask(); };
    this.playButton.onclick = () => this.play(!this.playing);
    this.what.onchange = () => { this.chart.take(this.motion, this.what.value); this.ask(); };
    canvas.ondblclick = () => { this.frame(); this.ask(); };
    this.hands(canvas);
    const seek = (event) => { this.play(false); this.show(this.chart.timeAt(event.offsetX)); };
    const chart = this.chart.canvas;
    chart.onpointerdown = (event) => { chart.setPointerCapture(event.pointerId); seek(event); };
    chart.onpointermove = (event) => { if (event.buttons) seek(event); };
    document.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.ask()).observe(this.root);
  }

  /** Show a motion, in the section of its file. */
  take(motion, section) {
    this.play(false);
    this.motion = motion;
    this.buttons = [...section.querySelectorAll(".findings button")];
    this.buttons.forEach((button, n) => { button.onclick = () => this.choose(motion.causes[n]); });
    this.root.classList.toggle("single", motion.isSingle);
    this.forces.hidden = !motion.forces;
    this.before.hidden = !motion.before;
    this.what.replaceChildren();
    const groups = new Map();
    const option = (group, value, text) => {
      if (!groups.has(group)) groups.set(group, make("optgroup", this.what, { label: group }));
      make("option", groups.get(group), { value, textContent: text });
    };
    motion.lines.forEach((line, n) => option("balance and contacts", `line:${n}`, line.name));
    for (const kind of ["position", "velocity"]) {
      motion.joints.forEach((joint, column) => {
        const { name, group } = this.robot.joints[joint];
        option(`${kind}: ${group}`, `${kind}:${column}`, `${kind} of ${name}`);
      });
    }
    if (motion.roots) {
      for (const name of BASE) option("base", `base:${name}`, `${name} of the base`);
      this.robot.links.forEach((link, n) => option("speed", `speed:${n}`, `speed of ${link.name}`));
    }
    const first = motion.causes.map((cause) => cause.plot).find((key) => key);
    this.plot(first || (motion.joints.length ? "position:0" : this.what.value));
    if (this.scene) {
      const poses = motion.poses(motion.begin);
      this.bounds = this.scene.bounds(poses);
      this.floor = motion.floor === null ? this.bounds[0][2] : motion.floor;
      this.frame();
    }
    this.show(motion.begin);
  }

  plot(key) {
    this.what.value = key;
    this.chart.take(this.motion, key);
  }

  /** Whether the robot of before is drawn, too. */
  isBefore() {
    return Boolean(this.motion.before) && !this.before.classList.contains("off");
  }

  /** Let the camera see the whole robot. */
  frame(yaw = 0.6, pitch = 0.3) {
    if (!this.bounds) return;
    const root = this.motion.root(this.motion.begin);
    const low = this.bounds[0];
    const high = this.isBefore() ? this.bounds[1].map((value, n) => value + BESIDE[n]) : this.bounds[1];
    const radius = 0.5 * Math.hypot(...low.map((value, n) => high[n] - value));
    const target = low.map((value, n) => (value + high[n]) / 2 - (n < 2 ? root[n] : 0));
    this.camera = { yaw, pitch, distance: (1.1 * radius) / LENS, target };
  }

  /** Show the worst time of a cause, from the side on which it is. */
  choose(cause) {
    this.play(false);
    if (cause.plot) this.plot(cause.plot);
    this.show(cause.time);
    const poses = this.motion.poses(cause.time);
    const points = this.balls(poses, cause.time, cause).map(({ center }) => center);
    const root = this.motion.root(cause.time);
    if (!points.length || !this.camera) return;
    const [x, y] = [0, 1].map((n) => points.reduce((sum, point) => sum + point[n], 0) / points.length - root[n]);
    if (Math.hypot(x, y) > 0.05) this.camera.yaw = Math.atan2(y, x) + 0.3;
  }

  show(time) {
    this.time = Math.min(Math.max(time, this.motion.begin), this.motion.end);
    this.ask();
  }

  play(playing) {
    this.playing = playing && !this.motion.isSingle;
    this.playButton.textContent = this.playing ? "❚❚" : "▶";
    this.last = null;
    if (!this.playing) return;
    if (this.time >= this.motion.end) this.time = this.motion.begin;
    this.ask();
  }

  /** Draw before the next picture of the window. */
  ask() {
    if (this.asked || !this.motion) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.frameAt(now);
    });
  }

  frameAt(now) {
    if (this.playing) {
      const passed = this.last === null ? 0 : now - this.last;
      if (passed > SLOW) this.quality = Math.max(0.5, 0.85 * this.quality);
      this.time = Math.min(this.time + (Number(this.speed.value) * passed) / 1000, this.motion.end);
      this.last = now;
      if (this.time >= this.motion.end) this.play(false);
    }
    this.draw(this.playing ? this.quality : 1);
    if (this.playing) this.ask();
  }

  draw(quality) {
    const { motion, time } = this;
    this.clock.textContent = `${time.toFixed(2)} / ${motion.end.toFixed(2)} s`;
    this.buttons.forEach((button, n) => button.classList.toggle("now", !motion.isSingle && motion.isAt(motion.causes[n], time)));
    if (!motion.isSingle) this.chart.draw(motion, time);
    if (!this.scene) return;
    this.poses = motion.poses(time);
    const balls = motion.causes.flatMap((cause) => this.balls(this.poses, time, cause));
    const now = motion.causes.flatMap((cause) => cause.findings).filter((found) => motion.isAt(found, time));
    const root = motion.root(time);
    const target = this.camera.target.map((value, n) => value + (n < 2 ? root[n] : 0));
    const arrows = this.forces.classList.contains("off") ? [] : motion.arrows(time);
    const before = this.isBefore() ? [motion.before.poses(time).map((pose) => pose.map((value, n) => value + (BESIDE[n] || 0)))] : [];
    this.scene.draw([this.poses, ...before], new Set(now.flatMap((found) => found.red)), balls, arrows, { ...this.camera, target }, this.floor, quality);
    this.label([...balls, ...arrows.map(({ start, text }) => ({ center: start, label: text, failed: true }))]);
  }

  /** The balls of a cause's findings at a time; the first one has the label. */
  balls(poses, time, cause) {
    const { motion, robot } = this;
    const found = cause.findings.filter((finding) => motion.isAt(finding, time)).flatMap((finding) => {
      const color = finding.failed ? RED : ORANGE;
      const about = { label: finding.label, failed: finding.failed, color };
      const points = finding.points.map((point, n) => ({
        ...about,
        center: finding.links[n] === undefined ? point : place(poses[finding.links[n]], point),
        radius: 0.015,
        alpha: 0.9,
      }));
      if (points.length || finding.joint === null) return points;
      const joint = robot.joints[finding.joint];
      return [{ ...about, center: place(poses[joint.link], joint.origin), radius: 0.065, alpha: 0.45 }];
    });
    return found.map((one, n) => (n ? { ...one, label: "" } : one));
  }

  /** Write labels next to their points, one below the other. */
  label(balls) {
    this.marks.forEach((mark) => mark.remove());
    const placed = balls.filter((one) => one.label)
      .map((one) => ({ ...one, at: this.scene.project(one.center) }))
      .filter((one) => one.at).sort((a, b) => a.at[1] - b.at[1]);
    let lowest = -Infinity;
    this.marks = placed.map(({ label, failed, at }) => {
      lowest = Math.max(at[1] - 10, lowest + 22);
      const mark = make("div", this.box, { className: failed ? "mark failed" : "mark", textContent: label });
      const most = this.box.clientWidth - mark.offsetWidth - 4;
      mark.style.transform = `translate(${Math.max(4, Math.min(at[0] + 16, most))}px, ${lowest}px)`;
      return mark;
    });
  }

  /** Turn by a drag, shift by one with shift, the right button or two fingers; zoom. */
  hands(canvas) {
    const fingers = new Map();
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    };
    canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
    canvas.onpointermove = (event) => {
      if (!fingers.has(event.pointerId) || !this.scene) return;
      const [x, y] = fingers.get(event.pointerId);
      const spread = () => {
        const [a, b] = [...fingers.values()];
        return Math.hypot(a[0] - b[0], a[1] - b[1]);
      };
      const before = fingers.size === 2 ? spread() : 0;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      const [dx, dy] = [event.clientX - x, event.clientY - y];
      if (fingers.size === 2) this.zoom(before / (spread() || 1));
      if (fingers.size === 2 || event.shiftKey || event.buttons & 6) {
        const scale = (2 * this.scene.lens() * this.camera.distance) / canvas.clientHeight / fingers.size;
        const { right, above } = this.scene.axes;
        this.camera.target = this.camera.target.map((value, n) => value - scale * (dx * right[n] - dy * above[n]));
      } else {
        this.camera.yaw -= 0.008 * dx;
        this.camera.pitch = Math.min(Math.max(this.camera.pitch + 0.008 * dy, -1.5), 1.5);
      }
      this.ask();
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0012 * event.deltaY));
    }, { passive: false });
  }

  zoom(factor) {
    if (!this.camera) return;
    this.camera.distance = Math.min(Math.max(this.camera.distance * factor, 0.2), 60);
    this.ask();
  }

  key(event) {
    if (!this.motion || /^(SELECT|INPUT)$/.test(event.target.tagName)) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " ") {
      event.preventDefault();
      this.play(!this.playing);
    } else if (step && !this.motion.isSingle) {
      this.play(false);
      this.show(this.time + step * this.motion.step);
    }
  }

  /** The matrix with which a link was last drawn, column-major. */
  matrix(name, robot = 0) {
    return this.scene.placed[robot][this.robot.links.findIndex((link) => link.name === name)];
  }
}

/** Sort the table of files by a column; numbers from the third one on, unknown ones last. */
const sortable = () => {
  const cells = (row, n) => row.cells[n].textContent;
  document.querySelectorAll(".files th").forEach((head, n) => {
    let sign = -1;
    head.onclick = () => {
      const body = head.closest("table").tBodies[0];
      sign = -sign;
      const number = (row) => parseFloat(cells(row, n));
      const rows = [...body.rows].slice(1).sort((a, b) => {
        const [x, y] = [number(a), number(b)];
        if (n > 1 && isNaN(x) !== isNaN(y)) return isNaN(x) ? 1 : -1;
        if (n > 1 && !isNaN(x)) return sign * (x - y);
        return sign * cells(a, n).localeCompare(cells(b, n));
      });
      body.append(...rows);
    };
  });
};

const start = () => {
  const robot = JSON.parse(document.getElementById("robot").textContent);
  const sections = [...document.querySelectorAll("section.file")];
  const overview = document.getElementById("overview");
  document.body.classList.add("live");
  sortable();
  const viewer = robot && new Viewer(robot);
  window.viewer = viewer;
  for (const section of sections) {
    const head = section.querySelector("h2");
    head.classList.add("fold");
    section.classList.add("folded"); // of no consequence in wide windows
    head.onclick = () => section.classList.toggle("folded");
  }
  const open = () => {
    const chosen = overview ? sections.find((section) => `#${section.id}` === location.hash) : sections[0];
    sections.forEach((section) => section.classList.toggle("shown", section === chosen));
    const content = chosen && chosen.querySelector("script");
    document.body.classList.toggle("shows", Boolean(chosen));
    if (viewer) viewer.root.hidden = !content;
    if (content) viewer.take(new Motion(robot, JSON.parse(content.textContent)), chosen);
    else if (viewer && viewer.motion) viewer.play(false);
  };
  window.addEventListener("hashchange", open);
  open();
};

start();
