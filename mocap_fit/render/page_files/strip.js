// The time line: waveform, words, phones, marks and curves. Drawn once a view; the cursor moves.

const ROWS = { wave: 52, words: 22, phones: 26, marks: 14, gap: 2, curve: 58 };
const AXIS = 18;

class Strip {
  constructor(record, canvas, cursor) {
    Object.assign(this, { record, canvas, cursor });
    this.start = record.start;
    this.end = Math.max(record.end, record.start + 1 / record.rate);
    this.view = [this.start, this.end];
    this.selection = null;
    this.panels = [];
    this.words = groupWords(record.phones);
  }

  get width() { return this.canvas.clientWidth; }
  toX(time) { return (time - this.view[0]) / (this.view[1] - this.view[0]) * this.width; }
  toTime(x) { return this.view[0] + x / this.width * (this.view[1] - this.view[0]); }

  // Names of parameters, and "residual", each with the tracks that have it.
  setCurves(names) {
    const record = this.record;
    this.panels = [];
    let top = 0;
    const add = (kind, height, more) => {
      this.panels.push({ kind, top, height, ...more });
      top += height;
    };
    if (record.sound) add("wave", ROWS.wave);
    if (this.words.length) add("words", ROWS.words);
    if (record.phones.length) add("phones", ROWS.phones);
    if (record.marks.length) add("marks", ROWS.marks);
    const gaps = findGaps(record.markers[0]);
    if (gaps.length) add("gaps", ROWS.gap * record.markers[0].names.length + 16, { gaps });
    for (const name of names) {
      const curves = record.tracks.map((track, number) => ({ track, number, ...pickCurve(track, name) }))
        .filter((curve) => curve.values);
      if (curves.length) add("curve", ROWS.curve, { name, curves, limits: findLimits(curves) });
    }
    this.height = top + AXIS;
    this.canvas.style.height = `${this.height}px`;
    this.draw();
  }

  setView(start, end) {
    const shortest = 4 / this.record.rate, full = this.end - this.start;
    const length = Math.min(Math.max(end - start, shortest), full);
    const first = Math.min(Math.max(0.5 * (start + end - length), this.start), this.end - length);
    this.view = [first, first + length];
    this.draw();
  }

  zoom(factor, around) {
    const [start, end] = this.view;
    this.setView(around + (start - around) * factor, around + (end - around) * factor);
  }

  // Turn the page when the cursor leaves it.
  follow(time) {
    const [start, end] = this.view;
    if (time >= start && time <= end) return;
    const length = end - start;
    this.setView(time - 0.05 * length, time + 0.95 * length);
  }

  prepare(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(this.height * ratio);
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    return pen;
  }

  draw() {
    const style = getComputedStyle(document.body);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
    this.font = style.fontFamily || "sans-serif";
    if (!this.width || !this.height) return;
    const pen = this.prepare(this.canvas);
    pen.textBaseline = "middle";
    for (const panel of this.panels) {
      pen.save();
      pen.beginPath();
      pen.rect(0, panel.top, this.width, panel.height);
      pen.clip();
      this[`draw_${panel.kind}`](pen, panel);
      pen.restore();
      pen.fillStyle = this.colour("line");
      pen.fillRect(0, panel.top + panel.height - 1, this.width, 1);
    }
    this.drawAxis(pen);
    this.drawCursor(this.now ?? this.start);
  }

  drawAxis(pen) {
    const top = this.height - AXIS, span = this.view[1] - this.view[0];
    const wanted = span * 80 / this.width, power = 10 ** Math.floor(Math.log10(wanted));
    const step = [1, 2, 5, 10].map((k) => k * power).find((each) => each >= wanted);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    pen.font = `11px ${this.font}`;
    pen.textAlign = "left";
    for (let k = Math.ceil(this.view[0] / step); k * step <= this.view[1]; k++) {
      const x = this.toX(k * step);
      pen.fillStyle = this.colour("line");
      pen.fillRect(x, top, 1, 5);
      pen.fillStyle = this.colour("soft");
      const text = `${(k * step).toFixed(digits)} s`;
      if (x + pen.measureText(text).width + 4 < this.width) pen.fillText(text, x + 3, top + 10);
    }
  }

  draw_wave(pen, panel) {
    const { peaks, step } = this.record.sound, count = peaks.length / 2;
    const middle = panel.top + panel.height / 2, size = (panel.height / 2 - 4) / 127;
    pen.fillStyle = this.colour("wave");
    for (let x = 0; x < this.width; x += 0.5) {
      let first = Math.floor((this.toTime(x) - this.start) / step);
      let last = Math.floor((this.toTime(x + 0.5) - this.start) / step);
      first = Math.max(first, 0);
      last = Math.min(Math.max(last, first), count - 1);
      let low = 127, high = -127;
      for (let i = first; i <= last; i++) {
        low = Math.min(low, peaks[2 * i]);
        high = Math.max(high, peaks[2 * i + 1]);
      }
      if (high >= low) pen.fillRect(x, middle - high * size, 0.5, Math.max((high - low) * size, 0.7));
    }
  }

  drawTier(pen, panel, entries, weight) {
    const line = this.colour("line"), ink = this.colour("ink");
    pen.textAlign = "center";
    for (const [start, end, text] of entries) {
      const left = this.toX(start), right = this.toX(end);
      if (right < 0 || left > this.width) continue;
      pen.fillStyle = line;
      pen.fillRect(left, panel.top, 1, panel.height);
      pen.fillRect(right, panel.top, 1, panel.height);
      pen.fillStyle = ink;
      for (const size of [13, 10, 8.5]) {
        pen.font = `${weight} ${size}px ${this.font}`;
        if (pen.measureText(text).width > right - left) continue;
        const centre = 0.5 * (Math.max(left, 0) + Math.min(right, this.width));
        pen.fillText(text, centre, panel.top + panel.height / 2);
        break;
      }
    }
  }

  draw_words(pen, panel) { this.drawTier(pen, panel, this.words, 400); }
  draw_phones(pen, panel) { this.drawTier(pen, panel, this.record.phones, 600); }

  draw_marks(pen, panel) {
    for (const mark of this.record.marks) {
      const left = this.toX(mark.start), right = Math.max(this.toX(mark.end), left + 3);
      pen.fillStyle = mark.severity === "error" ? this.colour("now") : this.colour("accent");
      pen.globalAlpha = mark.severity === "note" ? 0.4 : 0.85;
      pen.fillRect(left, panel.top + 3, right - left, panel.height - 7);
    }
    pen.globalAlpha = 1;
  }

  // A row for each marker, dark where it is missing.
  draw_gaps(pen, panel) {
    const { first, rate } = this.record;
    pen.fillStyle = this.colour("wave");
    for (const [row, from, to] of panel.gaps) {
      const left = this.toX(first + (from - 0.5) / rate), right = this.toX(first + (to - 0.5) / rate);
      pen.fillRect(left, panel.top + 14 + ROWS.gap * row, Math.max(right - left, 1), ROWS.gap);
    }
    pen.font = `11.5px ${this.font}`;
    pen.textAlign = "left";
    this.writeOn(pen, "missing markers", 6, panel.top + 9, this.colour("soft"));
  }

  draw_curve(pen, panel) {
    const [low, high] = panel.limits;
    const toY = (value) => panel.top + panel.height - 1 - (value - low) / (high - low) * (panel.height - 2);
    panel.toY = toY;
    pen.fillStyle = this.colour("faint");
    for (const [start, end] of this.record.phones)
      for (const time of [start, end]) pen.fillRect(this.toX(time), panel.top, 1, panel.height);
    pen.fillStyle = this.colour("line");
    pen.fillRect(0, toY(0), this.width, 1);
    const chosen = this.chosen ?? 0;
    // The chosen one is on top, with what is known of its uncertainty.
    const ordered = [...panel.curves].sort((a, b) => (a.number === chosen) - (b.number === chosen));
    for (const curve of ordered) {
      const colour = this.record.colours[curve.number % this.record.colours.length];
      if (curve.number === chosen && curve.deviations) this.drawBand(pen, curve, toY, colour);
      pen.strokeStyle = lighten(colour);
      pen.lineWidth = curve.number === chosen ? 2 : 1.4;
      this.drawLine(pen, curve, toY);
    }
    this.drawDifference(pen, panel, toY);
    pen.font = `11.5px ${this.font}`;
    pen.textAlign = "left";
    const text = panel.name.replaceAll("_", " ");
    this.writeOn(pen, text, 6, panel.top + 10, this.colour("soft"));
  }

  // A text that is legible above curves.
  writeOn(pen, text, left, middle, colour) {
    pen.globalAlpha = 0.8;
    pen.fillStyle = this.colour("panel");
    pen.fillRect(left - 2, middle - 7, pen.measureText(text).width + 4, 14);
    pen.globalAlpha = 1;
    pen.fillStyle = colour;
    pen.fillText(text, left, middle);
  }

  // What of a curve is visible: the numbers of its first and last frame.
  findVisible(curve) {
    const { rate, start } = curve.track;
    return [Math.max(Math.floor((this.view[0] - start) * rate) - 1, 0),
      Math.min(Math.ceil((this.view[1] - start) * rate) + 1, curve.length - 1)];
  }

  drawLine(pen, curve, toY) {
    const [first, last] = this.findVisible(curve), { rate, start } = curve.track;
    const step = Math.max(1, Math.floor((last - first) / this.width / 2));
    let drawing = false;
    pen.beginPath();
    const add = (frame, value) => {
      if (!Number.isFinite(value)) { drawing = false; return; }
      const x = this.toX(start + frame / rate), y = toY(value);
      if (drawing) pen.lineTo(x, y); else pen.moveTo(x, y);
      drawing = true;
    };
    for (let frame = first; frame <= last; frame += step) {
      if (step === 1) { add(frame, curve.at(frame)); continue; }
      // Of many frames in a pixel the least and the largest.
      let low = Infinity, high = -Infinity;
      for (let i = frame; i < Math.min(frame + step, last + 1); i++) {
        low = Math.min(low, curve.at(i));
        high = Math.max(high, curve.at(i));
      }
      add(frame, low);
      add(frame + step / 2, high);
    }
    pen.stroke();
  }

  // What the other face has more than the chosen one, at the frames of the chosen one.
  drawDifference(pen, panel, toY) {
    const [curve, other] = [this.chosen, this.compared].map((number) =>
      panel.curves.find((each) => each.number === number));
    if (!curve || !other || curve === other) return;
    const { rate, start } = curve.track;
    const at = (frame) => {
      const where = (start + frame / rate - other.track.start) * other.track.rate;
      const low = Math.floor(where + 1e-6), share = Math.max(where - low, 0);
      const next = share > 1e-6 ? other.at(low + 1) : 0;
      return other.at(low) * (1 - share) + next * share - curve.at(frame);
    };
    pen.setLineDash([4, 3]);
    pen.strokeStyle = this.colour("ink");
    pen.lineWidth = 1.2;
    this.drawLine(pen, { ...curve, at }, toY);
    pen.setLineDash([]);
  }

  // What is known of the uncertainty: one standard deviation on either side.
  drawBand(pen, curve, toY, colour) {
    const [first, last] = this.findVisible(curve), { rate, start } = curve.track;
    const step = Math.max(1, Math.floor((last - first) / this.width));
    let band = [];
    const fill = () => {
      pen.beginPath();
      band.forEach(([x, value, half]) => pen.lineTo(x, toY(value + half)));
      band.reverse().forEach(([x, value, half]) => pen.lineTo(x, toY(value - half)));
      pen.fill();
      band = [];
    };
    pen.fillStyle = colour;
    pen.globalAlpha = 0.18;
    for (let frame = first; frame <= last; frame += step) {
      const half = curve.deviation(frame), value = curve.at(frame);
      if (Number.isFinite(half + value)) band.push([this.toX(start + frame / rate), value, half]);
      else fill();
    }
    fill();
    pen.globalAlpha = 1;
  }

  // The moving part: the cursor, the selection, values at the cursor.
  drawCursor(now) {
    this.now = now;
    if (!this.width) return;
    const pen = this.prepare(this.cursor), bottom = this.height - AXIS;
    if (this.selection) {
      const [left, right] = this.selection.map((time) => this.toX(time));
      pen.fillStyle = this.colour("chosen");
      pen.fillRect(left, 0, right - left, this.height);
    }
    this.line = this.toX(now);
    pen.fillStyle = this.colour("now");
    pen.fillRect(this.line - 0.75, 0, 1.5, bottom);
    pen.font = `600 11px ${this.font}`;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    for (const panel of this.panels) {
      if (panel.kind !== "curve") continue;
      let right = this.width - 6;
      for (const curve of [...panel.curves].reverse()) {
        const value = curve.at(Math.round((now - curve.track.start) * curve.track.rate));
        if (!Number.isFinite(value)) continue;
        const text = value.toFixed(2).replace("-", "−"), wide = pen.measureText(text).width;
        const colour = lighten(this.record.colours[curve.number % this.record.colours.length]);
        this.writeOn(pen, text, right - wide, panel.top + 10, colour);
        right -= wide + 8;
      }
    }
  }

  // The phone or word that is at a point of the strip, as start and end; else null.
  findEntry(x, y) {
    const panel = this.panels.find((each) => y >= each.top && y < each.top + each.height);
    const tiers = { words: this.words, phones: this.record.phones };
    const entries = panel && tiers[panel.kind], time = this.toTime(x);
    const entry = entries && entries.find(([start, end]) => time >= start && time < end);
    return entry ? entry.slice(0, 2) : null;
  }

  // A click moves in time or selects a phone, a drag selects.
  listen(seek, select) {
    let from = null, dragged = false;
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      canvas.setPointerCapture(event.pointerId);
      from = event.offsetX;
      dragged = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (from === null || Math.abs(event.offsetX - from) < 4 && !dragged) return;
      dragged = true;
      const ends = [from, event.offsetX].map((x) =>
        Math.min(Math.max(this.toTime(x), this.start), this.end));
      select(Math.min(...ends), Math.max(...ends));
    });
    canvas.addEventListener("pointercancel", () => { from = null; });
    canvas.addEventListener("pointerup", (event) => {
      if (from === null) return;
      from = null;
      if (dragged) { seek(this.selection[0]); return; }
      const entry = this.findEntry(event.offsetX, event.offsetY);
      if (entry) { select(...entry); seek(entry[0]); return; }
      select(null);
      seek(this.toTime(event.offsetX));
    });
    canvas.addEventListener("wheel", (event) => {
      const sideways = Math.abs(event.deltaX) > Math.abs(event.deltaY) ? event.deltaX : 0;
      if (event.ctrlKey) this.zoom(Math.exp(event.deltaY * 0.002), this.toTime(event.offsetX));
      else if (sideways || event.shiftKey) {
        const shift = (sideways || event.deltaY) / this.width * (this.view[1] - this.view[0]);
        this.setView(this.view[0] + shift, this.view[1] + shift);
      } else return;
      event.preventDefault();
    }, { passive: false });
  }
}

// Phones that follow each other and are of one word.
function groupWords(phones) {
  const words = [];
  for (const [start, end, , word] of phones) {
    const last = words[words.length - 1];
    if (last && last[2] === word && Math.abs(last[1] - start) < 1e-6) last[1] = end;
    else words.push([start, end, word]);
  }
  return words.filter(([, , word]) => word);
}

// A parameter of a track, or its residual; no values where it has none.
function pickCurve(track, name) {
  if (name === "residual (mm)") {
    const values = track.residuals;
    return values ? { values, length: values.length, at: (frame) => values[frame] } : {};
  }
  const column = track.names.indexOf(name), width = track.names.length;
  if (column < 0) return {};
  const values = track.values, deviations = track.deviations;
  return {
    values, deviations, length: values.length / width,
    at: (frame) => (frame < 0 ? NaN : values[frame * width + column]),
    deviation: (frame) => deviations[frame * width + column],
  };
}

// Stretches in which a marker is missing: its number, the first frame and that after the last.
function findGaps(markers) {
  const gaps = [];
  if (!markers) return gaps;
  const { positions, names } = markers, frames = positions.length / names.length / 3;
  const isMissing = (frame, row) => positions[3 * (frame * names.length + row)] === GAP;
  // Before and after the recording nothing is missing.
  const any = (frame) => names.some((_, row) => !isMissing(frame, row));
  let start = 0, end = frames;
  while (start < end && !any(start)) start++;
  while (end > start && !any(end - 1)) end--;
  names.forEach((_, row) => {
    for (let frame = start, from = -1; frame <= end; frame++) {
      const missing = frame < end && isMissing(frame, row);
      if (missing && from < 0) from = frame;
      if (!missing && from >= 0) { gaps.push([row, from, frame]); from = -1; }
    }
  });
  return gaps;
}

function findLimits(curves) {
  let low = 0, high = 0.2;
  for (const curve of curves)
    for (let frame = 0; frame < curve.length; frame++) {
      const value = curve.at(frame);
      if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
    }
  const margin = 0.08 * (high - low);
  return [low - margin, high + 2.5 * margin];
}

// A colour that is as well visible on dark paper.
function lighten(colour) {
  if (!window.matchMedia("(prefers-color-scheme: dark)").matches) return colour;
  const parts = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  return `rgb(${parts.map((part) => Math.round(part + 0.42 * (255 - part))).join(" ")})`;
}
