// The head: shapes and weights to vertices, light on them, WebGL 2, the camera.

// A sum of shapes with a weight for each in every frame, such as a movement or its light.
class Blend {
  constructor({ middle, shapes, weights }) {
    this.rest = Float32Array.from(middle, (step) => step * middle.scale);
    this.values = new Float32Array(this.rest.length);
    this.size = shapes.shape[0];
    this.weights = weights;
    // Most of a head never moves: only the numbers that some shape changes are blended.
    const count = this.rest.length, moves = new Uint8Array(count);
    for (let i = 0; i < shapes.length; i++) if (shapes[i]) moves[i % count] = 1;
    this.moving = Int32Array.from(moves.keys()).filter((i) => moves[i]);
    this.parts = Array.from({ length: this.size }, (_, k) =>
      Float32Array.from(this.moving, (i) => shapes[k * count + i] * shapes.scale));
    this.sum = new Float32Array(this.moving.length);
  }

  // A frame of a head; a number between two frames is between them.
  compute(head, frame, frames) {
    const low = Math.min(Math.max(Math.floor(frame), 0), frames - 1);
    const high = Math.min(low + 1, frames - 1);
    const share = Math.min(Math.max(frame - low, 0), 1);
    const a = (head * frames + low) * this.size, b = (head * frames + high) * this.size;
    const { values, weights, moving, rest, sum } = this;
    sum.fill(0);
    this.parts.forEach((part, k) => {
      const weight = (1 - share) * weights[a + k] + share * weights[b + k];
      for (let i = 0; i < sum.length; i++) sum[i] += weight * part[i];
    });
    // Contact and the head's motion have moved others since.
    values.set(rest);
    for (let i = 0; i < moving.length; i++) values[moving[i]] += sum[i];
    return values;
  }
}

class Face {
  constructor(mesh) {
    this.mesh = mesh;
    this.movement = new Blend(mesh.movement);
    this.light = new Blend(mesh.light);
    this.vertices = this.movement.values;
    this.reach = this.light.values;
    this.normals = new Float32Array(this.vertices.length);
    this.count = this.vertices.length / 3;
    // Written as changes from frame to frame.
    const moves = mesh.contact.moves, size = 3 * mesh.contact.vertices.length;
    for (let i = size; i < moves.length; i++) moves[i] += moves[i - size];
  }

  pose(head, frame, frames) {
    this.movement.compute(head, frame, frames);
    this.light.compute(head, frame, frames);
    this.touch(head, frame, frames);
    this.moveHead(frame, frames);
    this.computeNormals();
  }

  // What contact moves: lips, tongue.
  touch(head, frame, frames) {
    const { vertices: ids, moves } = this.mesh.contact, p = this.vertices, count = 3 * ids.length;
    const low = Math.min(Math.floor(frame), frames - 1), high = Math.min(low + 1, frames - 1);
    const a = (head * frames + low) * count, b = (head * frames + high) * count;
    for (let i = 0; i < count; i++) {
      const move = moves[a + i] + (frame - low) * (moves[b + i] - moves[a + i]);
      p[3 * ids[(i / 3) | 0] + i % 3] += moves.scale * move;
    }
  }

  // The head turns about its joint, less down the neck, and shifts.
  moveHead(frame, frames) {
    const { joint, chin, foot, turns, shifts } = this.mesh.neck;
    const low = Math.min(Math.floor(frame), frames - 1), high = Math.min(low + 1, frames - 1);
    const at = (values, axis) => values[3 * low + axis]
      + (frame - low) * (values[3 * high + axis] - values[3 * low + axis]);
    const turn = [0, 1, 2].map((axis) => at(turns, axis));
    const shift = [0, 1, 2].map((axis) => at(shifts, axis));
    const angle = Math.hypot(...turn), p = this.vertices;
    if (angle === 0 && Math.hypot(...shift) === 0) return;
    const [x, y, z] = turn.map((value) => (angle ? value / angle : 0));
    const c = Math.cos(angle), s = Math.sin(angle), k = 1 - c;
    // What a rotation adds to a point.
    const r = [k * x * x + c - 1, k * x * y - s * z, k * x * z + s * y,
      k * x * y + s * z, k * y * y + c - 1, k * y * z - s * x,
      k * x * z - s * y, k * y * z + s * x, k * z * z + c - 1];
    for (let i = 0; i < p.length; i += 3) {
      const h = foot === null ? 1 : Math.min(Math.max((p[i + 1] - foot) / (chin - foot), 0), 1);
      const share = h * h * (3 - 2 * h);
      const a = p[i] - joint[0], b = p[i + 1] - joint[1], d = p[i + 2] - joint[2];
      p[i] += share * (r[0] * a + r[1] * b + r[2] * d) + shift[0];
      p[i + 1] += share * (r[3] * a + r[4] * b + r[5] * d) + shift[1];
      p[i + 2] += share * (r[6] * a + r[7] * b + r[8] * d) + shift[2];
    }
  }

  computeNormals() {
    const { vertices: p, normals: n } = this, triangles = this.mesh.triangles;
    n.fill(0);
    for (let t = 0, end = 3 * this.mesh.surface; t < end; t += 3) {
      const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      n[a] += x; n[a + 1] += y; n[a + 2] += z;
      n[b] += x; n[b + 1] += y; n[b + 2] += z;
      n[c] += x; n[c + 1] += y; n[c + 2] += z;
    }
  }
}

const FACE_VERTEX = `#version 300 es
precision highp float;
layout(location=0) in vec3 position;
layout(location=1) in vec3 normal;
layout(location=2) in vec3 reach;
layout(location=3) in vec4 albedo;
layout(location=4) in vec3 gloss;
uniform mat4 camera;
uniform vec3 light[9], light_on_skin[9];
out vec3 colour, where, across;
out vec4 shine;
void main() {
  vec3 n = normalize(normal);
  float terms[9] = float[9](1.0, n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.x * n.z,
    n.x * n.x - n.y * n.y, n.z * n.z);
  vec3 lit = vec3(0.0);
  for (int i = 0; i < 9; i++)
    lit += terms[i] * (albedo.a > 0.5 ? light_on_skin[i] : light[i]);
  colour = albedo.rgb * lit * reach;
  where = position;
  across = n;
  shine = vec4(gloss.x, gloss.y * 255.0, reach.g, gloss.z);
  gl_Position = camera * vec4(position, 1.0);
}`;

const FACE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour, where, across;
in vec4 shine;
uniform vec3 key, eye, background;
uniform float strength;
out vec4 pixel;
void main() {
  vec3 n = normalize(across), towards = normalize(eye - where);
  float bright = 0.0, along = dot(n, normalize(towards + key));
  if (along > 0.5 && dot(n, key) > 0.0)
    bright = strength * shine.x * sqrt(shine.y / 30.0) * pow(along, shine.y);
  // The lower edge fades into the background.
  pixel = vec4(mix(colour + bright * shine.z, background, shine.w), 1.0);
}`;

const POINT_VERTEX = `#version 300 es
precision highp float;
layout(location=0) in vec3 position;
layout(location=1) in vec3 tint;
layout(location=2) in float ring;
uniform mat4 camera;
uniform float size;
out vec3 colour;
out float hollow;
void main() {
  gl_Position = camera * vec4(position, 1.0);
  gl_PointSize = max(size / gl_Position.w, 4.0) * (1.0 + 0.6 * ring);
  colour = tint;
  hollow = ring;
}`;

const POINT_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour;
in float hollow;
uniform float round;
out vec4 pixel;
void main() {
  vec2 at = 2.0 * gl_PointCoord - 1.0;
  float far = dot(at, at);
  if (round > 0.5 && (far > 1.0 || far < 0.5 * hollow)) discard;
  vec3 n = vec3(at.x, -at.y, sqrt(max(1.0 - far, 0.0)));
  float ball = round * (1.0 - hollow);
  float light = mix(1.0, 0.62 + 0.38 * dot(n, normalize(vec3(0.4, 0.5, 0.77))), ball);
  pixel = vec4(colour * light, 1.0);
}`;

const VIEW_ANGLE = 18 * Math.PI / 180;
// Millimetres.
const BALL = 2;

class HeadView {
  // What is in the middle, from which distance, how wide it is: millimetres.
  constructor(canvas, mesh, { centre, distance, width }) {
    Object.assign(this, { canvas, centre, distance, width });
    this.face = mesh ? new Face(mesh) : null;
    this.turn = 0; this.lift = 0.02; this.zoom = 1; this.shift = [0, 0];
    this.columns = 1;
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("This browser has no WebGL 2, which draws the head.");
    this.gl = gl;
    this.points = this.build(POINT_VERTEX, POINT_FRAGMENT);
    this.pointBuffers = [3, 3, 1].map((size) => [gl.createBuffer(), size]);
    if (this.face) this.prepareFace(mesh);
  }

  build(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
        throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const name = gl.getActiveUniform(program, i).name;
      uniforms[name.replace("[0]", "")] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  prepareFace(mesh) {
    const gl = this.gl, looks = mesh.looks, count = this.face.count;
    this.shader = this.build(FACE_VERTEX, FACE_FRAGMENT);
    const albedo = new Uint8Array(4 * count), gloss = new Uint8Array(3 * count);
    for (let i = 0; i < count; i++) {
      albedo.set(looks.albedo.subarray(3 * i, 3 * i + 3), 4 * i);
      gloss.set([looks.specular[i], looks.power[i], looks.fading[i]], 3 * i);
    }
    for (const i of looks.skin) albedo[4 * i + 3] = 255;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    const add = (slot, size, kind, content) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, content, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, kind, kind !== gl.FLOAT, 0, 0);
      return buffer;
    };
    this.moving = [
      [add(0, 3, gl.FLOAT, this.face.vertices), this.face.vertices],
      [add(1, 3, gl.FLOAT, this.face.normals), this.face.normals],
      [add(2, 3, gl.FLOAT, this.face.reach), this.face.reach],
    ];
    add(3, 4, gl.UNSIGNED_BYTE, albedo);
    add(4, 3, gl.UNSIGNED_BYTE, gloss);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    const u = this.shader.uniforms;
    gl.useProgram(this.shader.program);
    gl.uniform3fv(u.light, looks.light.flat());
    gl.uniform3fv(u.light_on_skin, looks.light_on_skin.flat());
    gl.uniform3fv(u.key, looks.key);
    gl.uniform1f(u.strength, looks.strength);
  }

  // Fit the drawing buffer to the element.
  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(Math.round(this.canvas.clientWidth * ratio), 1);
    const height = Math.max(Math.round(this.canvas.clientHeight * ratio), 1);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
  }

  // The closer, the nearer the mouth is to the middle (as in the movie).
  findMiddle() {
    const lip = this.face ? this.face.mesh.lip : null;
    if (lip === null || this.zoom <= 1) return this.centre;
    const mouth = this.face.movement.rest.subarray(3 * lip, 3 * lip + 3), share = this.zoom ** -3;
    return this.centre.map((c, i) => mouth[i] + (c - mouth[i]) * share);
  }

  look() {
    const aspect = this.canvas.width / this.columns / this.canvas.height;
    // A narrow picture shows the head as wide.
    const wide = 2 * this.distance * Math.tan(VIEW_ANGLE / 2) * aspect;
    const distance = this.distance / this.zoom * Math.max(1, 1.06 * this.width / wide);
    const turn = this.turn, lift = this.lift;
    const back = [Math.sin(turn) * Math.cos(lift), Math.sin(lift), Math.cos(turn) * Math.cos(lift)];
    const right = [Math.cos(turn), 0, -Math.sin(turn)];
    const up = [-Math.sin(turn) * Math.sin(lift), Math.cos(lift), -Math.cos(turn) * Math.sin(lift)];
    const middle = this.findMiddle();
    const target = middle.map((c, i) => c + this.shift[0] * right[i] + this.shift[1] * up[i]);
    this.eye = target.map((c, i) => c + distance * back[i]);
    const near = distance * 0.2, far = distance * 3, f = 1 / Math.tan(VIEW_ANGLE / 2);
    const dot = (a) => a[0] * this.eye[0] + a[1] * this.eye[1] + a[2] * this.eye[2];
    const rows = [[...right, -dot(right)], [...up, -dot(up)], [...back, -dot(back)]];
    const [x, y, z] = rows, depth = (far + near) / (near - far);
    this.scale = f * this.canvas.height;
    // Columns of the product of projection and view.
    this.matrix = new Float32Array(16);
    for (let i = 0; i < 4; i++) {
      this.matrix[4 * i] = f / aspect * x[i];
      this.matrix[4 * i + 1] = f * y[i];
      this.matrix[4 * i + 2] = depth * z[i] + (i === 3 ? 2 * far * near / (near - far) : 0);
      this.matrix[4 * i + 3] = -z[i];
    }
  }

  // Where a point is in the picture of a column: pixels of the page, and its distance.
  project(point, column) {
    const m = this.matrix, [x, y, z] = point;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    const width = this.canvas.clientWidth / this.columns;
    return [
      (0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w + column) * width,
      (0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * this.canvas.clientHeight, w];
  }

  // Draw heads beside each other: numbers of tracks, a frame, points and lines of each head.
  draw(heads, frame, frames, marks, background) {
    const gl = this.gl;
    this.columns = heads.length;
    this.background = background;
    this.resize();
    this.look();
    gl.clearColor(...background, 1);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    heads.forEach((head, column) => {
      const left = Math.round(column * this.canvas.width / heads.length);
      gl.viewport(left, 0, Math.round(this.canvas.width / heads.length), this.canvas.height);
      if (this.face) this.drawFace(head, frame, frames);
      const { points, lines } = marks[column];
      if (lines.length) this.drawPoints(lines, gl.LINES);
      if (points.length) this.drawPoints(points, gl.POINTS);
    });
  }

  drawFace(head, frame, frames) {
    const gl = this.gl;
    this.face.pose(head, frame, frames);
    gl.enable(gl.CULL_FACE);
    gl.useProgram(this.shader.program);
    gl.uniformMatrix4fv(this.shader.uniforms.camera, false, this.matrix);
    gl.uniform3fv(this.shader.uniforms.eye, this.eye);
    gl.uniform3fv(this.shader.uniforms.background, this.background);
    gl.bindVertexArray(this.array);
    for (const [buffer, content] of this.moving) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, content);
    }
    const triangles = this.face.mesh.triangles;
    const kind = triangles instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT;
    gl.drawElements(gl.TRIANGLES, triangles.length, kind, 0);
    gl.bindVertexArray(null);
  }

  // Balls or rings, and ends of lines: a position and a colour each.
  drawPoints(points, kind) {
    const gl = this.gl;
    gl.useProgram(this.points.program);
    gl.uniformMatrix4fv(this.points.uniforms.camera, false, this.matrix);
    gl.uniform1f(this.points.uniforms.size, BALL * this.scale);
    gl.uniform1f(this.points.uniforms.round, kind === gl.POINTS ? 1 : 0);
    const contents = [points.flatMap((p) => p.position), points.flatMap((p) => p.colour),
      points.map((p) => p.ring || 0)];
    this.pointBuffers.forEach(([buffer, size], i) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(contents[i]), gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, size, gl.FLOAT, false, 0, 0);
    });
    gl.drawArrays(kind, 0, points.length);
  }

  // A direction from the face to the camera.
  setView([x, y, z]) {
    this.turn = Math.atan2(x, z);
    this.lift = Math.atan2(y, Math.hypot(x, z));
    this.shift = [0, 0];
    this.zoom = 1;
  }

  // Drag turns, with two fingers or the right button moves; wheel and pinch zoom.
  listen(changed) {
    const pointers = new Map(), canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const step = [now[0] - before[0], now[1] - before[1]];
      pointers.set(event.pointerId, now);
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.zoomBy(apart(now) / apart(before));
        this.move(step[0] / 2, step[1] / 2);
      } else if (event.buttons & 2 || event.shiftKey) {
        this.move(step[0], step[1]);
      } else {
        this.turn -= step[0] * 0.008;
        this.lift = Math.min(Math.max(this.lift + step[1] * 0.008, -1.5), 1.5);
      }
      changed();
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * 0.0012));
      changed();
    }, { passive: false });
  }

  zoomBy(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.4), 16);
  }

  move(right, down) {
    const high = 2 * this.distance * Math.tan(VIEW_ANGLE / 2);
    const millimetres = high / this.zoom / this.canvas.clientHeight;
    this.shift[0] -= right * millimetres;
    this.shift[1] += down * millimetres;
  }
}
