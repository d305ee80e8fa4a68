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

/** The surface of a profile, distances from and places along the z axis, that turns around it. */
const lathe = (profile) => {
  const [points, faces] = [[], []];
  profile.forEach(([radius, height], i) => {
    for (let j = 0; j <= 16; j += 1) {
      const around = (Math.PI * j) / 8;
      points.push(radius * Math.cos(around), radius * Math.sin(around), height);
      const k = 17 * i + j;
      if (i + 1 < profile.length && j < 16) faces.push(k, k + 17, k + 1, k + 1, k + 17, k + 18);
    }
  });
  return corners(new Float32Array(points), faces);
};
const BALL = Array.from({ length: 9 }, (_, i) => [Math.sin((Math.PI * i) / 8), Math.cos((Math.PI * i) / 8)]);
const SHAFT = [[0, 0], [1, 0], [1, 1], [0, 1]];
const HEAD = [[0, 0], [1, 0], [0, 1]];

/** Column-major matrix of a pose with a scale. */
const matrix = (pose, scale = 1) => {
  const axes = [0, 1, 2].map((n) => rotate(pose.slice(3), [0, 1, 2].map((m) => (m === n ? scale : 0))));
  return [...axes.flatMap((axis) => [...axis, 0]), ...pose.slice(0, 3), 1];
};
const product = (a, b) => a.map((_, n) =>
  [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (n % 4)] * b[4 * Math.floor(n / 4) + k], 0));

/** Matrix of what stands at a point along a vector: its radius, and its part of the vector. */
const upright = (start, vector, radius, begin, end) => {
  const length = Math.hypot(...vector);
  const along = vector.map((part) => part / length);
  const [x, y, z] = along;
  const across = Math.abs(x) < 0.7 ? [0, z, -y] : [-z, 0, x];
  const scale = radius / Math.hypot(...across);
  const u = across.map((part) => part * scale);
  const v = [y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0]];
  const from = start.map((part, n) => part + begin * along[n]);
  return [...u, 0, ...v, 0, ...along.map((part) => part * (end - begin)), 0, ...from, 1];
};

const RED = [0.85, 0.05, 0.05, 1];
const ORANGE = [0.95, 0.5, 0, 1];
const GREY = [0.72, 0.75, 0.8, 1];
const BLUE = [0.1, 0.35, 0.9, 1];
const SHORTEST = 0.01; // of arrows that are drawn, in m
const NEAR = 0.6; // objects in this distance from the robot are in view, in m
const LENS = Math.tan(0.25);

/** The name of what draws with WebGL; empty if nothing does. */
const rendererOf = (canvas) => {
  const gl = canvas.getContext("webgl2");
  const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const name = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  const end = gl && gl.getExtension("WEBGL_lose_context");
  if (end) end.loseContext();
  return name;
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
    [this.ball, this.shaft, this.head] = [BALL, SHAFT, HEAD].map((profile) => this.buffer(lathe(profile), 6));
    this.square = this.buffer(new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0]), 3);
    this.links = robot.links.length;
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

  /** The least and the largest coordinates of the robot, and of objects near it. */
  bounds(poses) {
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    const take = (some, isNear) => {
      for (const [link, vertices] of some) {
        for (let n = 0; n < vertices.length; n += 3) {
          const point = place(poses[link], [vertices[n], vertices[n + 1], vertices[n + 2]]);
          if (!isNear(point)) continue;
          point.forEach((value, axis) => {
            low[axis] = Math.min(low[axis], value);
            high[axis] = Math.max(high[axis], value);
          });
        }
      }
    };
    take(this.vertices.filter(([link]) => link < this.links), () => true);
    if (low[0] === Infinity) return [[-0.5, -0.5, 0], [0.5, 0.5, 1]];
    const [least, most] = [low.map((value) => value - NEAR), high.map((value) => value + NEAR)];
    const isNear = (point) => point.every((value, axis) => least[axis] < value && value < most[axis]);
    take(this.vertices.filter(([link]) => link >= this.links), isNear);
    return [low, high];
  }

  /** Draw robots, all but the first in grey; the camera looks at a target from yaw and pitch. */
  draw(robots, red, balls, arrows, camera, floor, quality) {
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
    const placed = this.placed = robots.map((poses) => poses.map((pose) => matrix(pose)));
    const shadow = [1, 0, 0, 0, 0, 1, 0, 0, -0.25, 0.2, 0, 0, 0.25 * floor, -0.2 * floor, floor, 1];
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.uniform1f(solid.shaded, 0);
    gl.uniform4f(solid.color, 0.15, 0.18, 0.25, 0.22);
    for (const matrices of pitch > 0 ? placed : []) {
      this.all(matrices.length, (patch) => gl.uniformMatrix4fv(solid.model, false, product(shadow, matrices[patch.link])), true);
    }
    gl.disable(gl.STENCIL_TEST);
    gl.enable(gl.DEPTH_TEST);
    gl.uniform1f(solid.shaded, 1);
    placed.forEach((matrices, number) => this.all(matrices.length, (patch) => {
      // A plane is not seen from behind, where it would hide all.
      if (patch.color[3] === 1) gl.disable(gl.CULL_FACE);
      else gl.enable(gl.CULL_FACE);
      const color = red.has(patch.link) ? RED : patch.color;
      gl.uniform4fv(solid.color, number ? GREY : color);
      gl.uniformMatrix4fv(solid.model, false, matrices[patch.link]);
    }));
    gl.disable(gl.CULL_FACE);
    gl.disable(gl.DEPTH_TEST); // contacts lie inside of links
    gl.bindVertexArray(this.ball.array);
    for (const { center, radius, color, alpha } of balls) {
      gl.uniform4f(solid.color, ...color.slice(0, 3), alpha);
      gl.uniformMatrix4fv(solid.model, false, matrix([...center, 0, 0, 0, 1], radius));
      gl.drawArrays(gl.TRIANGLES, 0, this.ball.count);
    }
    for (const { start, vector, isMissing } of arrows) {
      const length = Math.hypot(...vector);
      if (!(length > SHORTEST)) continue;
      const neck = length - Math.min(0.05, 0.5 * length);
      gl.uniform4f(solid.color, ...(isMissing ? RED : BLUE).slice(0, 3), 0.85);
      for (const [part, ...sizes] of [[this.shaft, 0.009, 0, neck], [this.head, 0.022, neck, length]]) {
        gl.bindVertexArray(part.array);
        gl.uniformMatrix4fv(solid.model, false, upright(start, vector, ...sizes));
        gl.drawArrays(gl.TRIANGLES, 0, part.count);
      }
    }
  }

  /** Draw the patches of as many links. */
  all(links, prepare, isOpaque = false) {
    for (const patch of this.patches.filter(({ link, color }) => link < links && (!isOpaque || color[3] === 1))) {
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
