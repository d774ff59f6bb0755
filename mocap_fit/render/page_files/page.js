// The page: the clock, what is chosen, the keys, the table.

const get = (id) => document.getElementById(id);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// The sound's clock, or that of the machine where there is none.
class Clock {
  constructor(record) {
    this.start = record.start;
    this.end = record.end;
    this.speed = 1;
    this.playing = false;
    this.time = record.start;
    if (!record.sound) return;
    const bytes = toBytes(record.sound.content);
    this.sound = new Audio(URL.createObjectURL(new Blob([bytes], { type: record.sound.type })));
    this.sound.preload = "auto";
    this.sound.preservesPitch = true;
  }

  now() {
    if (this.sound && this.playing) this.time = this.start + this.sound.currentTime;
    else if (this.playing)
      this.time = this.from + (performance.now() - this.since) / 1000 * this.speed;
    this.time = clamp(this.time, this.start, this.end);
    return this.time;
  }

  seek(time) {
    this.time = clamp(time, this.start, this.end);
    if (this.sound) this.sound.currentTime = this.time - this.start;
    this.from = this.time;
    this.since = performance.now();
  }

  async play() {
    if (this.end - this.now() < 1e-3) this.seek(this.start);
    this.seek(this.time);
    this.playing = true;
    if (!this.sound) return;
    this.sound.playbackRate = this.speed;
    await this.resume();
  }

  async resume() {
    try {
      await this.sound.play();
    } catch (fault) {
      // It was stopped before it began.
      if (fault.name !== "AbortError") throw fault;
    }
  }

  pause() {
    this.now();
    this.playing = false;
    if (this.sound) this.sound.pause();
  }

  setSpeed(speed) {
    this.seek(this.now());
    this.speed = speed;
    if (this.sound) this.sound.playbackRate = speed;
  }

  isAtEnd() {
    return this.sound ? this.sound.ended : this.time >= this.end;
  }
}

class Page {
  constructor(record) {
    this.record = record;
    this.clock = new Clock(record);
    this.strip = new Strip(record, get("curves"), get("cursor"));
    this.face = 0;
    this.beside = record.tracks.length > 1 ? 1 : -1;
    this.loop = false;
    this.stopAt = null;
    const mesh = record.mesh;
    this.view = new HeadView(get("head"), mesh, mesh || measurePoints(record.markers));
    this.names = record.tracks.map((track) => track.names).flat()
      .filter((name, i, all) => all.indexOf(name) === i);
    if (record.tracks.some((track) => track.residuals)) this.names.push("residual (mm)");
    this.shown = new Set(record.curves);
    this.fill();
    this.listen();
    this.showCurves();
    this.requested = false;
    this.request();
  }

  fill() {
    const record = this.record, still = record.end <= record.start;
    get("notes").textContent = record.notes.join(" · ");
    get("time").hidden = still;
    document.body.classList.toggle("still", still);
    get("labels").checked = still;
    const several = record.tracks.length > 1;
    fillSelect(get("face"), record.tracks.map((track, i) => [i, track.label]), this.face);
    fillSelect(get("beside"), [[-1, "nothing"], ...record.tracks.map((track, i) => [i, track.label])], this.beside);
    get("chooser").hidden = get("second").hidden = !several;
    get("pointing").hidden = get("naming").hidden = !record.markers.length;
    const kinds = [...new Set(record.markers.map((set) => set.label))].slice(0, 2);
    kinds.forEach((kind, i) => {
      const sign = document.createElement("b");
      sign.textContent = i ? "○" : "●";
      sign.style.color = `rgb(${POINT_COLOURS[i].map((part) => Math.round(255 * part)).join(" ")})`;
      get("pointing").append(sign, kind);
    });
    get("scrub").step = 1 / record.rate;
    get("scrub").max = record.end - record.start;
    for (const name of this.names) {
      addBox(name.replaceAll("_", " "), this.shown.has(name), (checked) => {
        if (checked) this.shown.add(name); else this.shown.delete(name);
        this.showCurves();
      });
    }
    if (several) addBox("difference of the two faces (dashed)", false, (checked) => {
      this.difference = checked;
      this.showCurves();
    });
    get("choices").hidden = !this.names.length;
    get("values").hidden = !(record.phones.length && record.tracks.length);
    const parameters = this.names.map((name) => [name, name.replaceAll("_", " ")]);
    fillSelect(get("parameter"), parameters, record.curves[0]);
    get("marks-box").hidden = !record.marks.length;
    for (const mark of record.marks) {
      const item = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.textContent = `${formatTime(mark.start)}: ${mark.text}`;
      button.addEventListener("click", () => {
        this.select(mark.start, Math.max(mark.end, mark.start + 1 / record.rate));
        this.seek(mark.start);
        this.strip.follow(mark.start);
      });
      item.append(button);
      get("marks").append(item);
    }
    this.fillTable();
    this.hint();
  }

  // --- time

  seek(time) {
    this.stopAt = null;
    this.clock.seek(time);
    this.strip.follow(this.clock.time);
    this.request();
  }

  async play(stopAt = null) {
    this.stopAt = stopAt;
    try {
      await this.clock.play();
    } catch (fault) {
      this.pause();
      showFault(fault);
    }
    this.showPlaying();
    this.request();
  }

  pause() {
    this.clock.pause();
    this.stopAt = null;
    this.showPlaying();
    this.request();
  }

  toggle() { return this.clock.playing ? this.pause() : this.play(); }

  playSelection() {
    this.clock.seek(this.strip.selection[0]);
    return this.play(this.strip.selection[1]);
  }

  step(frames) {
    this.pause();
    const { first, rate } = this.record;
    this.seek(first + (Math.round((this.clock.time - first) * rate) + frames) / rate);
  }

  select(start, end) {
    this.strip.selection = start === null ? null : [start, end];
    this.strip.drawCursor(this.clock.time);
    this.markRows();
    this.hint();
  }

  hint() {
    const selection = this.strip.selection;
    get("hint").textContent = selection
      ? `Selected: ${selection[0].toFixed(3)} to ${selection[1].toFixed(3)} s (${(selection[1] - selection[0]).toFixed(3)} s)`
      : "Click a phone to select it, or drag.";
  }

  setLoop(loop) {
    this.loop = loop;
    get("loop").setAttribute("aria-pressed", loop);
  }

  showPlaying() {
    const playing = this.clock.playing;
    get("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    get("icon").setAttribute("d", playing ? "M6.5 5h4v14h-4zM13.5 5h4v14h-4z" : "M7 4.5v15l12-7.5z");
  }

  // --- drawing

  request() {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame(() => {
      this.requested = false;
      this.draw();
      if (this.clock.playing) this.request();
    });
  }

  // Go back or stop where the selection, or all, ends.
  turnAround(time) {
    const [start, end] = this.loop
      ? this.strip.selection || [this.record.start, this.record.end]
      : [null, this.stopAt ?? Infinity];
    if (time < end && !this.clock.isAtEnd()) return time;
    if (this.loop) {
      this.clock.seek(start);
      if (this.clock.sound) this.clock.resume();
      return start;
    }
    const last = Math.min(end, this.record.end);
    this.pause();
    this.clock.seek(last);
    return last;
  }

  draw() {
    let time = this.clock.now();
    if (this.clock.playing) time = this.turnAround(time);
    // Pictures may come late, or not at all while another window hides this one.
    clearTimeout(this.turning);
    const end = this.loop ? (this.strip.selection || [0, this.record.end])[1] : this.stopAt;
    if (this.clock.playing && end)
      this.turning = setTimeout(() => this.draw(), 1000 * (end - time) / this.clock.speed);
    this.drawHead(time);
    if (this.clock.playing) this.strip.follow(time);
    this.strip.drawCursor(time);
    get("clock").textContent = formatTime(time);
    get("scrub").value = time - this.record.start;
    get("scrub").setAttribute("aria-valuetext", formatTime(time));
  }

  drawHead(time) {
    const record = this.record, heads = [this.face];
    if (this.beside >= 0) heads.push(this.beside);
    this.frame = clamp((time - record.first) * record.rate, 0, record.frames - 1);
    const background = getComputedStyle(get("view")).backgroundColor.match(/[\d.]+/g)
      .slice(0, 3).map((part) => part / 255);
    const shown = get("points").checked ? record.markers : [];
    const marks = heads.map((head) => this.listPoints(
      shown.filter((set) => set.head === null || set.head === head)));
    this.view.draw(heads, this.frame, record.frames, marks, background);
    this.drawNames(marks, heads);
  }

  // Markers at the frame, and lines between the first two sets, redder for longer ones.
  listPoints(sets) {
    const frame = Math.round(this.frame), points = [], lines = [], first = new Map();
    sets.forEach(({ names, positions, label }, number) => names.forEach((name, k) => {
      const i = 3 * (frame * names.length + k);
      if (positions[i] === GAP) return;
      const position = [0, 1, 2].map((axis) => positions[i + axis] * positions.scale);
      const point = { position, name, set: label, ring: number ? 1 : 0 };
      point.colour = POINT_COLOURS[point.ring];
      points.push(point);
      const other = first.get(name);
      if (number === 0) first.set(name, point);
      else if (other && number === 1) {
        const distance = Math.hypot(...position.map((value, axis) => value - other.position[axis]));
        const colour = [Math.min(0.3 + distance / 4, 1), Math.max(0.55 - distance / 6, 0.05), 0.15];
        lines.push({ position, colour }, { position: other.position, colour });
        point.distance = other.distance = distance;
      }
    }));
    return { points, lines };
  }

  drawNames(marks, heads) {
    const canvas = get("names"), ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d"), colour = this.strip.colour;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const captions = heads.length > 1 || this.record.tracks.length > 1
      ? heads.map((head) => this.record.tracks[head]) : [];
    get("captions").replaceChildren(...captions.map((track, i) => {
      const span = document.createElement("span"), label = document.createElement("b");
      label.textContent = track.label;
      label.style.color = lighten(this.record.colours[heads[i] % this.record.colours.length]);
      span.append(label);
      return span;
    }));
    const write = (point, column, text) => {
      const [x, y] = this.view.project(point.position, column);
      pen.font = `11px ${this.strip.font}`;
      pen.textBaseline = "middle";
      const left = Math.min(x + 6, canvas.clientWidth - pen.measureText(text).width - 6);
      this.strip.writeOn(pen, text, left, y, colour("ink"));
    };
    if (get("labels").checked)
      for (const point of marks[0].points) if (!point.ring) write(point, 0, point.name);
    const near = this.findPoint(marks);
    if (near) {
      const far = near.point.distance === undefined ? "" : `, ${near.point.distance.toFixed(2)} mm apart`;
      write(near.point, near.column, `${near.point.name} (${near.point.set}${far})`);
    }
  }

  // The marker under the mouse.
  findPoint(marks) {
    if (!this.mouse) return null;
    let best = 10, nearest = null;
    marks.forEach(({ points }, column) => points.forEach((point) => {
      const [x, y] = this.view.project(point.position, column);
      const far = Math.hypot(x - this.mouse[0], y - this.mouse[1]);
      if (far < best) { best = far; nearest = { point, column }; }
    }));
    return nearest;
  }

  showCurves() {
    this.strip.chosen = this.face;
    this.strip.compared = this.difference ? this.beside : -1;
    this.strip.setCurves(this.names.filter((name) => this.shown.has(name)));
  }

  // --- values per phone

  // Minimum, mean and maximum of a parameter of a track in each phone.
  measurePhones(track, name) {
    const curve = pickCurve(track, name);
    return this.record.phones.map(([start, end]) => {
      if (!curve.values) return [NaN, NaN, NaN];
      const first = Math.max(Math.ceil((start - track.start) * track.rate - 1e-6), 0);
      const last = Math.min(Math.ceil((end - track.start) * track.rate - 1e-6), curve.length);
      const values = [];
      for (let i = first; i < last; i++) if (Number.isFinite(curve.at(i))) values.push(curve.at(i));
      if (!values.length) return [NaN, NaN, NaN];
      const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
      return [Math.min(...values), mean, Math.max(...values)];
    });
  }

  fillTable() {
    const { phones, tracks } = this.record, name = get("parameter").value;
    if (!phones.length || !tracks.length) return;
    const measured = tracks.map((track) => this.measurePhones(track, name));
    const cell = (tag, text, kind = "") => {
      const element = document.createElement(tag);
      element.textContent = text;
      if (kind) element.className = kind;
      return element;
    };
    const over = document.createElement("tr"), header = document.createElement("tr");
    over.append(cell("th", ""), cell("th", ""), cell("th", ""), cell("th", ""));
    header.append(cell("th", "phone", "text"), cell("th", "word", "text"),
      cell("th", "start, s"), cell("th", "end, s"));
    for (const track of tracks) {
      const title = cell("th", track.label, "track");
      title.colSpan = 3;
      over.append(title);
      for (const text of ["min", "mean", "max"]) header.append(cell("th", text));
    }
    const head = document.createElement("thead"), body = document.createElement("tbody");
    head.append(over, header);
    phones.forEach(([start, end, phone, word], row) => {
      const line = document.createElement("tr");
      line.append(cell("td", phone, "text"), cell("td", word, "text"),
        cell("td", start.toFixed(3)), cell("td", end.toFixed(3)));
      for (const values of measured) values[row].forEach((value, i) => line.append(
        cell("td", formatValue(value, 3), i ? "" : "first")));
      line.addEventListener("click", () => { this.select(start, end); this.seek(start); });
      body.append(line);
    });
    get("table").replaceChildren(head, body);
    this.markRows();
  }

  markRows() {
    const selection = this.strip.selection;
    const rows = get("table").tBodies[0]?.rows || [];
    this.record.phones.forEach(([start, end], i) => rows[i]?.classList.toggle(
      "chosen", !!selection && start >= selection[0] - 1e-6 && end <= selection[1] + 1e-6));
  }

  // Everything, a row for each track, phone and parameter, as statistics programs want it.
  toTable() {
    const { phones, tracks } = this.record;
    const rows = [["track", "phone", "word", "start_s", "end_s", "parameter", "minimum", "mean", "maximum"]];
    for (const track of tracks)
      for (const name of track.names)
        this.measurePhones(track, name).forEach((values, i) => {
          const [start, end, phone, word] = phones[i];
          rows.push([track.label, phone, word, start.toFixed(4), end.toFixed(4), name,
            ...values.map((value) => (Number.isFinite(value) ? value.toFixed(4) : ""))]);
        });
    return rows.map((row) => row.join("\t")).join("\n") + "\n";
  }

  async copy() {
    const text = this.toTable();
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Pages from disk may not have the clipboard.
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    get("copied").textContent = "Copied.";
    setTimeout(() => { get("copied").textContent = ""; }, 2000);
  }

  // --- what people do

  listen() {
    const on = (id, event, action) => get(id).addEventListener(event, action);
    this.view.listen(() => this.request());
    this.strip.listen((time) => this.seek(time), (start, end) => this.select(start, end));
    on("play", "click", () => this.toggle());
    on("scrub", "input", () => this.seek(this.record.start + Number(get("scrub").value)));
    on("speed", "change", () => this.clock.setSpeed(Number(get("speed").value)));
    on("loop", "click", () => this.setLoop(!this.loop));
    on("face", "change", () => { this.face = Number(get("face").value); this.showCurves(); this.request(); });
    on("beside", "change", () => { this.beside = Number(get("beside").value); this.showCurves(); this.request(); });
    for (const id of ["points", "labels"]) on(id, "change", () => this.request());
    for (const button of document.querySelectorAll("[data-view]"))
      button.addEventListener("click", () => this.look(button.dataset.view));
    on("zoom-in", "click", () => this.strip.zoom(0.5, this.clock.time));
    on("zoom-out", "click", () => this.strip.zoom(2, this.clock.time));
    on("zoom-all", "click", () => this.strip.setView(this.strip.start, this.strip.end));
    on("zoom-selection", "click", () => this.zoomToSelection());
    on("parameter", "change", () => this.fillTable());
    on("copy", "click", () => this.copy());
    on("head", "mousemove", (event) => { this.mouse = [event.offsetX, event.offsetY]; this.request(); });
    on("head", "mouseleave", () => { this.mouse = null; this.request(); });
    document.addEventListener("keydown", (event) => this.press(event));
    new ResizeObserver(() => { this.strip.draw(); this.request(); }).observe(get("strip"));
    new ResizeObserver(() => this.request()).observe(get("view"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.strip.draw();
      this.request();
    });
  }

  look(name) {
    this.view.setView(this.record.views[name]);
    this.request();
  }

  zoomToSelection() {
    if (this.strip.selection) this.strip.setView(...this.strip.selection);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target, name = target.tagName;
    const typing = name === "SELECT" || name === "TEXTAREA";
    // A control that was reached by the keyboard keeps its own keys.
    const pressing = (name === "BUTTON" || name === "SUMMARY" || target.type === "checkbox")
      && target.matches(":focus-visible");
    const { start, end } = this.record, selection = this.strip.selection;
    const actions = {
      " ": () => this.toggle(),
      ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1),
      Home: () => this.seek(start), End: () => this.seek(end),
      Escape: () => { this.pause(); this.select(null); },
      l: () => this.setLoop(!this.loop),
      i: () => this.strip.zoom(0.5, this.clock.time), o: () => this.strip.zoom(2, this.clock.time),
      n: () => this.zoomToSelection(), a: () => this.strip.setView(this.strip.start, this.strip.end),
      1: () => this.look("front"), 7: () => this.look("three-quarter"), 3: () => this.look("side"),
    };
    // Without a selection, and on controls, Tab goes to the next control as everywhere.
    if (event.key === "Tab") {
      const free = target === document.body || target === get("curves") || target === get("head");
      if (selection && free && !event.shiftKey) { event.preventDefault(); this.playSelection(); }
      return;
    }
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || typing || pressing && event.key === " ") return;
    event.preventDefault();
    action();
  }
}

// The code of a missing marker, and the colours of balls and rings.
const GAP = -32768;
const POINT_COLOURS = [[0.10, 0.45, 0.85], [0.95, 0.55, 0.10]];

function fillSelect(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  if (chosen !== undefined) select.value = chosen;
}

// A box to tick among the curves.
function addBox(text, checked, changed) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.checked = checked;
  box.addEventListener("change", () => changed(box.checked));
  label.append(box, text);
  get("parameters").append(label);
}

function formatTime(time) { return `${time.toFixed(3)} s`; }

function formatValue(value, digits) {
  return Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "–";
}

// The box around all markers, where there is no face.
function measurePoints(sets) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const { positions } of sets)
    for (let i = 0; i < positions.length; i++) {
      if (positions[i] === GAP) continue;
      const value = positions[i] * positions.scale, axis = i % 3;
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    }
  const centre = low.map((value, axis) => (Number.isFinite(value) ? 0.5 * (value + high[axis]) : 0));
  const [width, height] = low.map((value, axis) => Math.max(high[axis] - value, 50) || 100);
  return { centre, width, distance: 0.65 * height / Math.tan(VIEW_ANGLE / 2) };
}

function showFault(fault) {
  console.error(fault);
  get("fault").textContent = `This does not work here: ${fault.message || fault}`;
  get("fault").hidden = false;
}

const ready = readRecord().then((record) => { window.page = new Page(record); }).catch(showFault);
