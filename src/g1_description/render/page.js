"use strict";

// --- poses: x y z and a unit quaternion x y z w, as in motions --------------------------

const rotate = ([x, y, z, w], [a, b, c]) => {
  const [u, v, t] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u];
};
const multiply = ([a, b, c, d], [x, y, z, w]) => [
  d * x + a * w + b * z - c * y,
  d * y - a * z + b * w + c * x,
  d * z + a * y - b * x + c * w,
  d * w - a * x - b * y - c * z,
];
const place = (pose, point) => {
  const [x, y, z] = rotate(pose.slice(3), point);
  return [x + pose[0], y + pose[1], z + pose[2]];
};
const compose = (a, b) => [...place(a, b), ...multiply(a.slice(3), b.slice(3))];
const inside = (pose, point) => {
  const [x, y, z, w] = pose.slice(3);
  return rotate([-x, -y, -z, w], point.map((value, n) => value - pose[n]));
};
const IDENTITY = [0, 0, 0, 0, 0, 0, 1];

const decode = (text, Kind) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
};

/** The last row whose time is not later, from 0 to length - 2. */
const rowBefore = (times, time) => {
  let [low, high] = [0, Math.max(times.length - 1, 1)];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return low;
};

/** Intervals that overlap as one. */
const joined = (intervals) => {
  const found = [];
  for (const [first, last] of [...intervals].sort((a, b) => a[0] - b[0])) {
    const before = found[found.length - 1];
    if (before && first <= before[1]) before[1] = Math.max(before[1], last);
    else found.push([first, last]);
  }
  return found;
};

// --- a motion ---------------------------------------------------------------------------

class Motion {
  constructor(robot, content) {
    Object.assign(this, content);
    this.robot = robot;
    this.times = decode(content.times, Float64Array);
    this.positions = decode(content.positions, Float32Array);
    const optional = (text) => text && decode(text, Float32Array);
    this.velocities = optional(content.velocities);
    this.roots = optional(content.roots);
    this.begin = this.times[0];
    this.end = this.times[this.times.length - 1];
    this.isSingle = this.times.length === 1;
    this.step = this.isSingle ? Infinity : (this.end - this.begin) / (this.times.length - 1);
    const rows = Object.fromEntries(robot.links.map((link, row) => [link.name, row]));
    for (const cause of this.causes) {
      for (const finding of cause.findings) {
        const poses = this.poses(finding.time);
        finding.links = finding.links.map((name) => rows[name]);
        finding.red = finding.red.map((name) => rows[name]);
        finding.points = finding.points.map((point, n) =>
          finding.links[n] === undefined ? point : inside(poses[finding.links[n]], point));
      }
      cause.failed = cause.findings.some((finding) => finding.failed);
      cause.intervals = joined(cause.findings.flatMap((finding) => finding.intervals));
    }
  }

  /** The rows before and after a time, the fraction between them and their distance. */
  between(time) {
    const row = rowBefore(this.times, time);
    const next = Math.min(row + 1, this.times.length - 1);
    const gap = this.times[next] - this.times[row] || 1;
    return [row, next, Math.min(Math.max((time - this.times[row]) / gap, 0), 1), gap];
  }

  /** Position and velocity of a joint of the motion: linear, or cubic with velocities. */
  joint(column, time) {
    const [row, next, s, gap] = this.between(time);
    const n = this.joints.length;
    const [p, q] = [this.positions[row * n + column], this.positions[next * n + column]];
    if (!this.velocities) return [p + s * (q - p), (q - p) / gap];
    const u = gap * this.velocities[row * n + column];
    const v = gap * this.velocities[next * n + column];
    const [square, cube] = [3 * (q - p) - 2 * u - v, u + v - 2 * (q - p)];
    return [p + s * (u + s * (square + s * cube)), (u + s * (2 * square + 3 * s * cube)) / gap];
  }

  root(time) {
    if (!this.roots) return IDENTITY;
    const [row, next, s] = this.between(time);
    const [a, b] = [row, next].map((n) => [...this.roots.slice(7 * n, 7 * n + 7)]);
    const mix = (x, y, r) => x.map((value, n) => value + r * (y[n] - value));
    let cos = a.slice(3).reduce((sum, value, n) => sum + value * b[n + 3], 0);
    const sign = cos < 0 ? -1 : 1;
    cos = Math.min(Math.abs(cos), 1);
    const angle = Math.acos(cos);
    const [from, to] = angle < 1e-4 ? [1 - s, s]
      : [Math.sin((1 - s) * angle) / Math.sin(angle), Math.sin(s * angle) / Math.sin(angle)];
    const turn = a.slice(3).map((value, n) => from * value + sign * to * b[n + 3]);
    const length = Math.hypot(...turn);
    return [...mix(a.slice(0, 3), b, s), ...turn.map((value) => value / length)];
  }

  /** Poses of all links. */
  poses(time) {
    const positions = new Array(this.robot.joints.length).fill(0);
    this.joints.forEach((joint, column) => { positions[joint] = this.joint(column, time)[0]; });
    const root = this.root(time);
    const poses = [];
    for (const link of this.robot.links) {
      if (link.parent === undefined) {
        poses.push(root);
        continue;
      }
      let pose = link.rest;
      if (link.joint !== null) {
        const { axis, origin, slides } = this.robot.joints[link.joint];
        const position = positions[link.joint];
        if (slides) {
          pose = compose(pose, [...axis.map((part) => part * position), 0, 0, 0, 1]);
        } else {
          const sin = Math.sin(position / 2);
          const turn = [...axis.map((part) => part * sin), Math.cos(position / 2)];
          const moved = rotate(turn, origin);
          pose = compose(pose, [...origin.map((part, n) => part - moved[n]), ...turn]);
        }
      }
      poses.push(compose(poses[link.parent], pose));
    }
    return poses;
  }

  /** Whether a finding or cause is there at a time. */
  isAt(found, time) {
    const room = 0.5 * this.step + 1e-6;
    return Math.abs(time - found.time) < room || found.intervals.some(
      ([first, last]) => first - room < time && time < last + room);
  }
}

// --- drawing ----------------------------------------------------------------------------

const SOLID = [`#version 300 es
  in vec3 point, normal;
  uniform mat4 view, model;
  out vec3 place, side;
  void main() {
    vec4 world = model * vec4(point, 1.0);
    place = world.xyz;
    side = mat3(model) * normal;
    gl_Position = view * world;
  }`, `#version 300 es
  precision highp float;
  in vec3 place, side;
  uniform vec3 eye, lamp;
  uniform vec4 color;
  uniform float shaded;
  out vec4 pixel;
  void main() {
    vec3 towards = normalize(eye - place), n = normalize(side);
    n = dot(n, towards) < 0.0 ? -n : n;
    float light = 0.52 + 0.1 * n.z + 0.48 * max(dot(n, lamp), 0.0);
    float gloss = 0.12 * pow(max(dot(n, normalize(lamp + towards)), 0.0), 24.0);
    pixel = vec4(mix(color.rgb, color.rgb * light + gloss, shaded), color.a);
  }`];

const FLOOR = [`#version 300 es
  in vec3 point;
  uniform mat4 view;
  uniform vec3 middle;
  out vec2 place;
  out vec2 away;
  void main() {
    vec3 world = vec3(middle.xy + 15.0 * point.xy, middle.z);
    place = world.xy;
    away = point.xy;
    gl_Position = view * vec4(world, 1.0);
  }`, `#version 300 es
  precision highp float;
  in vec2 place, away;
  out vec4 pixel;
  float lines(float cell, float width) {
    vec2 size = fwidth(place / cell);
    vec2 off = abs(fract(place / cell - 0.5) - 0.5);
    vec2 wide = max(vec2(width / cell), size);
    vec2 seen = clamp(0.5 + (0.5 * wide - off) / size, 0.0, 1.0) * width / cell / wide;
    seen *= 1.0 - smoothstep(0.25, 0.5, size);
    return max(seen.x, seen.y);
  }
  void main() {
    float fade = exp(-24.0 * dot(away, away));
    pixel = vec4(0.2, 0.25, 0.32, fade * (0.04 + 0.2 * max(lines(0.25, 0.003), 2.0 * lines(1.0, 0.006))));
  }`];

/** Corners of triangles with normals, 6 numbers each: smooth, but not over edges. */
const corners = (vertices, faces) => {
  const n = faces.length;
  const flat = new Float32Array(n);
  const first = new Uint32Array(vertices.length / 3 + 1);
  const point = (corner, axis) => vertices[3 * faces[corner] + axis];
  for (let k = 0; k < n; k += 3) {
    const [a, b, c, d, e, f] = [1, 2].flatMap((m) =>
      [0, 1, 2].map((axis) => point(k + m, axis) - point(k, axis)));
    flat.set([b * f - c * e, c * d - a * f, a * e - b * d], k);
  }
  for (let k = 0; k < n; k += 1) first[faces[k] + 1] += 1;
  for (let k = 1; k < first.length; k += 1) first[k] += first[k - 1];
  const around = new Uint32Array(n);
  const filled = first.slice();
  for (let k = 0; k < n; k += 1) around[filled[faces[k]]++] = k - (k % 3);
  const made = new Float32Array(6 * n);
  for (let k = 0; k < n; k += 1) {
    const own = k - (k % 3);
    const [a, b, c] = [flat[own], flat[own + 1], flat[own + 2]];
    const length = Math.hypot(a, b, c);
    let [x, y, z] = [0, 0, 0];
    for (let m = first[faces[k]]; m < first[faces[k] + 1]; m += 1) {
      const other = around[m];
      const [d, e, f] = [flat[other], flat[other + 1], flat[other + 2]];
      if (a * d + b * e + c * f < 0.8 * length * Math.hypot(d, e, f)) continue;
      x += d; y += e; z += f;
    }
    made.set([point(k, 0), point(k, 1), point(k, 2), x, y, z], 6 * k);
  }
  return made;
};

const ball = () => {
  const [points, faces] = [[], []];
  for (let i = 0; i <= 8; i += 1) {
    for (let j = 0; j <= 16; j += 1) {
      const [up, around] = [(Math.PI * i) / 8, (Math.PI * j) / 8];
      points.push(Math.sin(up) * Math.cos(around), Math.sin(up) * Math.sin(around), Math.cos(up));
      const k = 17 * i + j;
      if (i < 8 && j < 16) faces.push(k, k + 17, k + 1, k + 1, k + 17, k + 18);
    }
  }
  return corners(new Float32Array(points), faces);
};

/** Column-major matrix of a pose with a scale. */
const matrix = (pose, scale = 1) => {
  const axes = [0, 1, 2].map((n) => rotate(pose.slice(3), [0, 1, 2].map((m) => (m === n ? scale : 0))));
  return [...axes.flatMap((axis) => [...axis, 0]), ...pose.slice(0, 3), 1];
};
const product = (a, b) => a.map((_, n) =>
  [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (n % 4)] * b[4 * Math.floor(n / 4) + k], 0));

const RED = [0.85, 0.05, 0.05, 1];
const ORANGE = [0.95, 0.5, 0, 1];
const LENS = Math.tan(0.25);

/** The name of what draws with WebGL; empty if nothing does. */
const rendererOf = (canvas) => {
  const gl = canvas.getContext("webgl2");
  const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
};

class Scene {
  constructor(canvas, robot) {
    this.canvas = canvas;
    // Where the processor draws, antialiasing takes most of the time.
    const antialias = !/swiftshader|llvmpipe|software/i.test(rendererOf(document.createElement("canvas")));
    const gl = canvas.getContext("webgl2", { alpha: false, antialias, stencil: true });
    if (!gl) throw new Error("This browser has no WebGL 2, so the robot is not drawn.");
    this.gl = gl;
    this.solid = this.program(SOLID);
    this.floor = this.program(FLOOR);
    this.ball = this.buffer(ball(), 6);
    this.square = this.buffer(new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0]), 3);
    this.vertices = [];
    this.patches = robot.patches.map((patch) => {
      const raw = decode(patch.vertices, Uint16Array);
      const vertices = new Float32Array(raw.length);
      for (let n = 0; n < raw.length; n += 1) {
        vertices[n] = patch.corner[n % 3] + raw[n] * patch.step[n % 3];
      }
      this.vertices.push([patch.link, vertices]);
      const faces = decode(patch.faces, patch.wide ? Uint32Array : Uint16Array);
      return { ...this.buffer(corners(vertices, faces), 6), link: patch.link, color: patch.color };
    });
    this.patches.sort((a, b) => b.color[3] - a.color[3]);
  }

  program([vertex, fragment]) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["point", "normal"].forEach((name, n) => gl.bindAttribLocation(program, n, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`The robot cannot be drawn: ${gl.getProgramInfoLog(program)}`);
    }
    const places = {};
    for (const name of ["view", "model", "color", "eye", "lamp", "shaded", "middle"]) {
      places[name] = gl.getUniformLocation(program, name);
    }
    return { program, ...places };
  }

  buffer(numbers, width) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    for (let n = 0; n < width / 3; n += 1) {
      gl.enableVertexAttribArray(n);
      gl.vertexAttribPointer(n, 3, gl.FLOAT, false, 4 * width, 12 * n);
    }
    return { array, count: numbers.length / width };
  }

  /** The least and the largest coordinates of the robot. */
  bounds(poses) {
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (const [link, vertices] of this.vertices) {
      for (let n = 0; n < vertices.length; n += 3) {
        place(poses[link], [vertices[n], vertices[n + 1], vertices[n + 2]]).forEach((value, axis) => {
          low[axis] = Math.min(low[axis], value);
          high[axis] = Math.max(high[axis], value);
        });
      }
    }
    return this.vertices.length ? [low, high] : [[-0.5, -0.5, 0], [0.5, 0.5, 1]];
  }

  /** Draw; the camera looks at a target from yaw and pitch. */
  draw(poses, red, balls, camera, floor, quality) {
    const { gl, canvas } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2) * quality;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) =>
      Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.933, 0.945, 0.961, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const { yaw, pitch, distance, target } = camera;
    const towards = (turn, up) => [Math.cos(up) * Math.cos(turn), Math.cos(up) * Math.sin(turn), Math.sin(up)];
    const back = towards(yaw, pitch);
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    const above = towards(yaw, pitch + Math.PI / 2);
    const eye = target.map((value, n) => value + distance * back[n]);
    const dot = (a) => -a.reduce((sum, value, n) => sum + value * eye[n], 0);
    const look = [0, 1, 2].flatMap((n) => [right[n], above[n], back[n], 0]);
    look.push(dot(right), dot(above), dot(back), 1);
    const [near, far] = [0.03 * distance, 40 + 3 * distance];
    const lens = this.lens();
    const depth = [0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
    this.view = product([1 / (lens * (width / height)), 0, 0, 0, 0, 1 / lens, 0, 0, ...depth], look);
    this.axes = { right, above };

    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.floor.program);
    gl.uniformMatrix4fv(this.floor.view, false, this.view);
    gl.uniform3f(this.floor.middle, target[0], target[1], floor);
    gl.bindVertexArray(this.square.array);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);

    const solid = this.solid;
    gl.useProgram(solid.program);
    gl.uniformMatrix4fv(solid.view, false, this.view);
    gl.uniform3fv(solid.eye, eye);
    gl.uniform3fv(solid.lamp, towards(yaw - 0.66, 0.87));
    this.matrices = poses.map((pose) => matrix(pose));
    const shadow = [1, 0, 0, 0, 0, 1, 0, 0, -0.25, 0.2, 0, 0, 0.25 * floor, -0.2 * floor, floor, 1];
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.uniform1f(solid.shaded, 0);
    gl.uniform4f(solid.color, 0.15, 0.18, 0.25, 0.22);
    if (pitch > 0) this.all((patch) => gl.uniformMatrix4fv(solid.model, false, product(shadow, this.matrices[patch.link])));
    gl.disable(gl.STENCIL_TEST);
    gl.enable(gl.DEPTH_TEST);
    gl.uniform1f(solid.shaded, 1);
    this.all((patch) => {
      gl.uniform4fv(solid.color, red.has(patch.link) ? RED : patch.color);
      gl.uniformMatrix4fv(solid.model, false, this.matrices[patch.link]);
    });
    gl.disable(gl.DEPTH_TEST); // contacts lie inside of links
    gl.bindVertexArray(this.ball.array);
    for (const { center, radius, color, alpha } of balls) {
      gl.uniform4f(solid.color, ...color.slice(0, 3), alpha);
      gl.uniformMatrix4fv(solid.model, false, matrix([...center, 0, 0, 0, 1], radius));
      gl.drawArrays(gl.TRIANGLES, 0, this.ball.count);
    }
  }

  all(prepare) {
    for (const patch of this.patches) {
      prepare(patch);
      this.gl.bindVertexArray(patch.array);
      this.gl.drawArrays(this.gl.TRIANGLES, 0, patch.count);
    }
  }

  /** Half of the height of what is seen at a distance of 1; its width if that is less. */
  lens() {
    return LENS / Math.min(1, this.canvas.clientWidth / this.canvas.clientHeight);
  }

  /** Where a point is in the window, in pixels; null behind the eye. */
  project(point) {
    const [x, y, , w] = [0, 1, 2, 3].map((n) => [...point, 1].reduce((sum, value, k) => sum + value * this.view[4 * k + n], 0));
    if (w <= 0) return null;
    return [(0.5 + (0.5 * x) / w) * this.canvas.clientWidth, (0.5 - (0.5 * y) / w) * this.canvas.clientHeight];
  }
}

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

  /** Take a motion, and what is plotted of it: position:COLUMN, velocity:COLUMN, line:ROW. */
  take(motion, key) {
    const [kind, number] = [key.split(":")[0], Number(key.split(":")[1])];
    this.key = key;
    this.bounds = [];
    const joint = motion.robot.joints[motion.joints[number]];
    if (kind === "line") {
      const line = motion.lines[number];
      this.times = decode(line.times, Float64Array);
      this.values = decode(line.values, Float32Array);
      this.unit = line.unit;
      this.bounds = [0];
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
    const row = rowBefore(this.times, time);
    const near = time - this.times[row] > this.times[row + 1] - time ? row + 1 : row;
    const value = this.values[near];
    if (value === undefined || Number.isNaN(value)) return;
    g.fillStyle = COLOR.line;
    g.beginPath();
    g.arc(this.x(time), y(value), 3.5, 0, 7);
    g.fill();
    const isRight = this.x(time) > this.width - 120;
    g.textAlign = isRight ? "right" : "left";
    const text = `${value.toFixed(3)} ${this.unit}`;
    const x = this.x(time) + (isRight ? -9 : 9);
    const size = g.measureText(text).width;
    g.fillStyle = "#ffffffd8";
    g.fillRect(isRight ? x - size - 2 : x - 2, top, size + 4, 15);
    g.fillStyle = COLOR.line;
    g.fillText(text, x, top + 8);
  }
}

// --- the page ---------------------------------------------------------------------------

/** Make an element; names and texts of files only ever become text. */
const make = (tag, into, values = {}) => into.appendChild(Object.assign(document.createElement(tag), values));

const VIEWS = { Front: [0, 0.1], Side: [-Math.PI / 2, 0.1], Back: [Math.PI, 0.1] };
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
    if (document.getElementById("overview")) {
      make("a", this.box, { id: "back", href: "#", textContent: "◂ All files" });
    }
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
    for (const [name, [yaw, pitch]] of Object.entries(VIEWS)) {
      make("button", views, { textContent: name, onclick: () => { this.frame(yaw, pitch); this.ask(); } });
    }
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

  /** Let the camera see the whole robot. */
  frame(yaw = 0.6, pitch = 0.3) {
    if (!this.bounds) return;
    const root = this.motion.root(this.motion.begin);
    const [low, high] = this.bounds;
    const radius = 0.5 * Math.hypot(...low.map((value, n) => high[n] - value));
    const target = low.map((value, n) => (value + high[n]) / 2 - (n < 2 ? root[n] : 0));
    this.camera = { yaw, pitch, distance: (1.1 * radius) / LENS, target };
  }

  /** Show the worst time of a cause, from the side on which it is. */
  choose(cause) {
    this.play(false);
    if (cause.plot) this.plot(cause.plot);
    this.show(cause.time);
    const points = this.balls(cause.time, cause).map(({ center }) => center);
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
    const balls = motion.causes.flatMap((cause) => this.balls(time, cause));
    const now = motion.causes.flatMap((cause) => cause.findings).filter((found) => motion.isAt(found, time));
    const root = motion.root(time);
    const target = this.camera.target.map((value, n) => value + (n < 2 ? root[n] : 0));
    this.scene.draw(this.poses, new Set(now.flatMap((found) => found.red)), balls, { ...this.camera, target }, this.floor, quality);
    this.label(balls);
  }

  /** The balls of a cause's findings at a time; the first one has the label. */
  balls(time, cause) {
    const { motion, robot } = this;
    const poses = this.poses && time === this.time ? this.poses : motion.poses(time);
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
  matrix(name) {
    return this.scene.matrices[this.robot.links.findIndex((link) => link.name === name)];
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
