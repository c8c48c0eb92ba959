// The player of a report: plan view, 3-D, values and curves of one flight, or of several over one
// another; player.py writes the data. Of a flight that goes on, the page gives it the newest moments
// by events "flown" (extensions/browser), and it is hidden before the first. North, east, up in
// metres; times in seconds of the slider. All text of a run is set as text, never as markup.
"use strict";
(() => {
  const TRAIL_POINTS = 200; // of a trail, at most
  const FLYING = 1, LIVE = 2;
  const root = document.getElementById("player");
  const flight = JSON.parse(document.getElementById("flight").textContent);
  const part = (name) => root.querySelector(`[data-part="${name}"]`);
  const make = (kind, text = "", name = "") =>
    Object.assign(document.createElement(kind), { textContent: text, className: name });
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

  // ---- the flights

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const metres = (text, grain, middle) =>
    Float32Array.from(new Int16Array(bytes(text)), (whole, k) =>
      whole === -32768 ? NaN : whole * grain + middle[k % middle.length]);
  const moved = (text, zero) => new Float32Array(bytes(text)).map((t) => t - zero);

  // Moments as player_parts.py writes them.
  function unpacked(told, zero) {
    const [north, east, down] = told.middle_m;
    return {
      times: moved(told.times_s, zero),
      places: metres(told.places, told.grain_m, [north, east, down]),
      away: metres(told.away, told.grain_m, [0, 0]),
      states: new Uint8Array(bytes(told.states)),
      curve: {
        times: moved(told.curves.times_s, zero),
        near: new Float32Array(bytes(told.curves.near_m)),
        error: new Float32Array(bytes(told.curves.error_m)),
        pairs: new Uint16Array(bytes(told.curves.pairs)),
      },
    };
  }

  const runs = flight.runs.map((run, k) => {
    const n = run.agents.length;
    const shift = (told) => told.map((one) => ({ ...one, t: one.t - run.zero_s }));
    return {
      ...run, n, k,
      steps: shift(run.steps), marks: shift(run.marks),
      ...unpacked(run, run.zero_s),
      now: Array.from({ length: n }, () => ({})),
    };
  });
  const several = runs.length > 1;
  let first = 0, last = 0;
  function span() {
    first = Math.min(...runs.map((run) => run.times[0] ?? 0));
    last = Math.max(...runs.map((run) => run.times.at(-1) ?? 0));
  }
  span();

  // The index of the last time that is not after t; 0 before all of them.
  function before(times, t) {
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  // Where the vehicles of a run are at t, into run.now.
  function sample(run, t) {
    const k = Math.min(before(run.times, t), run.times.length - 2);
    const share = clamp((t - run.times[k]) / (run.times[k + 1] - run.times[k]), 0, 1);
    const between = (values, at, width) => {
      const low = values[at], high = values[at + run.n * width];
      return low + share * (high - low);
    };
    run.at = k;
    run.now.forEach((one, i) => {
      const place = (k * run.n + i) * 3, away = (k * run.n + i) * 2;
      one.north = between(run.places, place, 3);
      one.east = between(run.places, place + 1, 3);
      one.up = -between(run.places, place + 2, 3);
      one.slotNorth = one.north - between(run.away, away, 2);
      one.slotEast = one.east - between(run.away, away + 1, 2);
      one.state = run.states[(k + (share >= 0.5 ? 1 : 0)) * run.n + i];
    });
  }

  // Calls back with the places of each vehicle's trail, oldest first, and its place now.
  function trails(run, t, each) {
    const length = Number(part("trails").value);
    if (!length) return;
    const from = before(run.times, t - length);
    const stride = Math.max(1, Math.ceil((run.at - from) / TRAIL_POINTS));
    run.now.forEach((one, i) => {
      const points = [];
      for (let k = Math.ceil(from / stride) * stride; k <= run.at; k += stride) {
        const at = (k * run.n + i) * 3;
        points.push([run.places[at], run.places[at + 1], -run.places[at + 2]]);
      }
      points.push([one.north, one.east, one.up]);
      each(points, i);
    });
  }

  // Calls back with each pair in the air that is nearer than r_out.
  function nearPairs(run, each) {
    run.now.forEach((a, i) => run.now.slice(i + 1).forEach((b) => {
      const apart = Math.hypot(a.north - b.north, a.east - b.east);
      if (a.state & b.state & FLYING && apart < run.r_out_m) each(a, b, apart < run.r_in_m);
    }));
  }

  // ---- colours

  let ink = {};
  function readColours() {
    const style = getComputedStyle(root);
    for (const name of ["ink", "paper", "panel", "near", "hit", "grid", "axis", "faint"])
      ink[name] = style.getPropertyValue(`--${name}`).trim();
  }
  function colour(run, i) {
    const found = flight.colours[(several ? run.k : run.inks[i]) % flight.colours.length];
    return found === "#000000" ? ink.ink : found;
  }

  // ---- views

  let time = 0, fresh = true;
  // A zone that was added or lifted in flight is drawn while it holds.
  const inForce = (run) => run.zones.filter((zone) =>
    (zone.since ?? -Infinity) <= time + run.zero_s && time + run.zero_s < (zone.until ?? Infinity));
  const paint = () => { fresh = true; };

  function fitted(canvas) {
    const sharp = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "12px system-ui, sans-serif";
    return { pen, width, height };
  }

  // A step of 1, 2 or 5 times a power of ten, about as large as wanted.
  function tick(wanted) {
    const power = 10 ** Math.floor(Math.log10(wanted));
    return power * ([1, 2, 5].find((k) => k * power >= wanted) || 10);
  }

  function path(pen, points, style, width, dash = []) {
    pen.beginPath();
    let down = false;
    for (const [x, y] of points) {
      if (Number.isNaN(x)) { down = false; continue; }
      if (down) pen.lineTo(x, y); else pen.moveTo(x, y);
      down = true;
    }
    pen.strokeStyle = style;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  function words(pen, text, x, y, style = ink.ink) {
    pen.lineWidth = 3;
    pen.strokeStyle = ink.panel;
    pen.strokeText(text, x, y);
    pen.fillStyle = style;
    pen.fillText(text, x, y);
  }

  // A vehicle: full while it flies under its agent, hollow on the ground, dashed without an agent.
  function disc(pen, x, y, radius, style, one) {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.globalAlpha = 0.85;
    pen.fillStyle = one.state & LIVE ? style : ink.panel;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = style;
    pen.lineWidth = 1.5;
    if (one.state & FLYING && !(one.state & LIVE)) pen.setLineDash([3, 2]);
    pen.stroke();
    pen.setLineDash([]);
  }

  // A canvas that is dragged, zoomed and turned. `place` is where (north, east, up) is on it.
  class View {
    constructor(canvas) {
      this.canvas = canvas;
      this.reset();
      new ResizeObserver(paint).observe(canvas);
      canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
      canvas.addEventListener("pointermove", (e) => {
        if (canvas.hasPointerCapture(e.pointerId)) this.change(() => this.drag(e.movementX, e.movementY));
      });
      canvas.addEventListener("dblclick", () => this.change(() => this.reset()));
      canvas.addEventListener("wheel", (e) => {
        if (document.activeElement !== canvas) return; // else the page scrolls
        e.preventDefault();
        this.change(() => { this.zoom *= Math.exp(-e.deltaY / 500); });
      }, { passive: false });
      canvas.addEventListener("keydown", (e) => this.key(e));
    }
    change(how) { how(); paint(); }
    reset() { this.zoom = 1; this.shift = [0, 0]; }
    key(e) {
      const does = {
        ArrowLeft: () => this.drag(30, 0), ArrowRight: () => this.drag(-30, 0),
        ArrowUp: () => this.drag(0, 30), ArrowDown: () => this.drag(0, -30),
        "+": () => { this.zoom *= 1.25; }, "-": () => { this.zoom /= 1.25; },
        0: () => this.reset(),
      }[e.key];
      if (does) { e.preventDefault(); e.stopPropagation(); this.change(does); }
    }
    // Middle (north, east, up) and radius [m] of what is shown.
    frame() {
      if (!part("follow").checked) return extent;
      const flying = runs.flatMap((run) => run.now).filter((one) => one.state & FLYING);
      const shown = flying.length ? flying : runs.flatMap((run) => run.now);
      const [middle, half] = box(shown.map((one) => [one.north, one.east, one.up]));
      const reach = Math.max(1.3 * half[0], 1.3 * half[1], 3 * runs[0].r_in_m);
      return [middle, [reach, reach, half[2]]];
    }
    draw() {
      const { pen, width, height } = fitted(this.canvas);
      this.aim(width, height, ...this.frame());
      pen.lineJoin = "round";
      this.ground(pen, width, height);
      for (const run of runs) this.below(pen, run);
      for (const run of runs) this.targets(pen, run);
      for (const run of runs) this.vehicles(pen, run);
    }
    below(pen, run) {
      run.homes.forEach((home, i) => {
        if (!home) return;
        const [x, y] = this.place(...home, 0);
        pen.strokeStyle = colour(run, i);
        pen.lineWidth = 1;
        pen.strokeRect(x - 4, y - 4, 8, 8);
      });
      const put = (point) => this.place(...point);
      pen.globalAlpha = clamp(60 / run.links.length, 0.1, 1); // hundreds would hide the rest
      if (part("links").checked)
        for (const [i, j] of run.links) {
          const ends = [run.now[i], run.now[j]].map((one) => this.place(one.north, one.east, one.up));
          path(pen, ends, ink.faint, 1);
        }
      pen.globalAlpha = 0.75;
      trails(run, time, (points, i) => path(pen, points.map(put), colour(run, i), 1.3));
      pen.globalAlpha = 1;
      nearPairs(run, (a, b, hit) => path(pen,
        [a, b].map((one) => this.place(one.north, one.east, one.up)),
        hit ? ink.hit : ink.near, hit ? 4 : 2));
    }
    // A ring with a point: where news puts it now, and how old that is where it is old.
    targets(pen, run) {
      for (const target of run.targets) {
        const t = time + run.zero_s, k = before(target.times, t);
        if (!target.times.length || target.times[k] > t) continue;
        const next = target.at[k + 1], age = t - target.times[k];
        const gap = next ? target.times[k + 1] - target.times[k] : Infinity;
        const share = gap < 2 ? age / gap : 0; // else it stays where it was last told to be
        const [n, e, d] = target.at[k].map((low, c) => low + share * ((next || target.at[k])[c] - low));
        const from = before(target.times, t - Number(part("trails").value));
        path(pen, target.at.slice(from, k + 1).map(([a, b, c]) => this.place(a, b, -c)), ink.ink, 1, [2, 3]);
        const [x, y] = this.place(n, e, -d);
        for (const radius of [2, 6]) {
          pen.beginPath();
          pen.arc(x, y, radius, 0, 2 * Math.PI);
          pen.strokeStyle = ink.ink;
          pen.lineWidth = 1.5;
          pen.stroke();
        }
        words(pen, age > 1 ? `${target.name}, ${age.toFixed(0)} s ago` : target.name, x + 9, y + 4, ink.axis);
      }
    }
    vehicles(pen, run) {
      const shown = run.now.map((one, i) => ({ one, i, at: this.place(one.north, one.east, one.up) }))
        .filter(({ at }) => !Number.isNaN(at[0])).sort((a, b) => b.at[2] - a.at[2]);
      for (const { one, i, at: [x, y] } of shown) {
        const radius = Math.max(3, this.scale * run.r_in_m / 2);
        if (part("slots").checked && one.state & LIVE && !Number.isNaN(one.slotNorth)) {
          const [sx, sy] = this.place(one.slotNorth, one.slotEast, one.up);
          pen.beginPath();
          pen.arc(sx, sy, radius + 2.5, 0, 2 * Math.PI);
          pen.strokeStyle = ink.axis;
          pen.lineWidth = 1;
          pen.setLineDash([2, 2]);
          pen.stroke();
          pen.setLineDash([]);
        }
        disc(pen, x, y, radius, colour(run, i), one);
      }
      if (part("names").checked)
        for (const { i, at: [x, y] } of shown) {
          const beside = 3 + Math.max(3, this.scale * run.r_in_m / 2) * 0.75;
          words(pen, run.labels[i], x + beside, y - beside);
        }
    }
  }

  class Plan extends View {
    drag(x, y) { this.shift = [this.shift[0] + x / this.zoom, this.shift[1] + y / this.zoom]; }
    aim(width, height, [north, east], [halfNorth, halfEast]) {
      const fit = Math.min((width - 60) / (2 * halfEast), (height - 60) / (2 * halfNorth));
      this.scale = fit * this.zoom;
      const [x, y] = this.shift.map((pixels) => pixels * this.zoom);
      this.place = (n, e) => [width / 2 + x + (e - east) * this.scale,
        height / 2 + y - (n - north) * this.scale, 0];
      this.back = (px, py) => [north - (py - height / 2 - y) / this.scale,
        east + (px - width / 2 - x) / this.scale];
    }
    ground(pen, width, height) {
      const step = tick(70 / this.scale);
      const [top, left] = this.back(0, 0), [bottom, right] = this.back(width, height);
      for (let e = Math.ceil(left / step) * step; e < right; e += step) {
        const [x] = this.place(0, e);
        path(pen, [[x, 0], [x, height]], ink.grid, 1);
        words(pen, `${Number(e.toPrecision(6))}`, x + 3, height - 5, ink.axis);
      }
      for (let n = Math.ceil(bottom / step) * step; n < top; n += step) {
        const [, y] = this.place(n, 0);
        path(pen, [[0, y], [width, y]], ink.grid, 1);
        if (y > 30) words(pen, `${Number(n.toPrecision(6))}`, 3, y - 3, ink.axis); // else: `north`
      }
      words(pen, "east [m]", width - 52, height - 20, ink.axis);
      words(pen, "north [m]", 3, 14, ink.axis);
      for (const run of runs)
        for (const zone of inForce(run)) {
          const at = zone.at.map((p) => this.place(...p));
          path(pen, [...at, at[0]], ink.hit, 1);
          pen.globalAlpha = 0.15;
          pen.fillStyle = ink.hit;
          pen.fill();
          pen.globalAlpha = 1;
          words(pen, zone.name, at[0][0] + 3, at[0][1] - 3, ink.axis);
        }
      for (const run of runs)
        if (run.fence_m.length)
          path(pen, [...run.fence_m, run.fence_m[0]].map((p) => this.place(...p)), ink.hit, 1, [6, 4]);
    }
  }

  class Scene extends View {
    reset() { super.reset(); this.turn = -0.6; this.tilt = 0.45; }
    drag(x, y) {
      this.turn += x / 150;
      this.tilt = clamp(this.tilt + y / 150, 0.03, Math.PI / 2);
    }
    aim(width, height, [north, east, up], [halfNorth, halfEast, halfUp]) {
      const reach = Math.hypot(halfNorth, halfEast, halfUp);
      this.scale = 0.45 * Math.min(width, 1.4 * height) / reach * this.zoom;
      this.middle = [north, east, reach];
      const [sinT, cosT, sinP, cosP] = [Math.sin(this.turn), Math.cos(this.turn),
        Math.sin(this.tilt), Math.cos(this.tilt)];
      this.place = (n, e, u) => {
        const [x, y, z] = [e - east, n - north, u - up];
        const deep = (x * sinT + y * cosT) * cosP - z * sinP;
        const near = 4 * reach / Math.max(4 * reach + deep, reach);
        return [width / 2 + (x * cosT - y * sinT) * this.scale * near,
          height / 2 - ((x * sinT + y * cosT) * sinP + z * cosP) * this.scale * near, deep];
      };
    }
    ground(pen) {
      const [north, east, reach] = this.middle;
      const step = tick(reach / 3), half = Math.ceil(1.2 * reach / step) * step;
      const n0 = Math.round(north / step) * step, e0 = Math.round(east / step) * step;
      for (let d = -half; d <= half + step / 2; d += step) {
        path(pen, [this.place(n0 + d, e0 - half, 0), this.place(n0 + d, e0 + half, 0)], ink.grid, 1);
        path(pen, [this.place(n0 - half, e0 + d, 0), this.place(n0 + half, e0 + d, 0)], ink.grid, 1);
      }
      const name = (text, n, e) => words(pen, text, ...this.place(n, e, 0).slice(0, 2), ink.axis);
      for (const run of runs)
        for (const zone of inForce(run)) {
          const ends = [zone.floor ?? 0, zone.ceiling ?? Math.max(zone.floor ?? 0, 0) + reach / 2];
          for (const up of ends)
            path(pen, [...zone.at, zone.at[0]].map((p) => this.place(...p, up)), ink.hit, 1);
          const every = Math.ceil(zone.at.length / 8);
          for (const p of zone.at.filter((_, k) => k % every === 0))
            path(pen, ends.map((up) => this.place(...p, up)), ink.hit, 1);
          words(pen, zone.name, ...this.place(...zone.at[0], ends[1]).slice(0, 2), ink.axis);
        }
      for (const run of runs) {
        const around = run.fence_m.length ? [...run.fence_m, run.fence_m[0]] : [];
        for (const up of [0, run.fence_height_m ?? 0])
          path(pen, around.map((p) => this.place(...p, up)), ink.hit, 1, [6, 4]);
        for (const p of run.fence_m)
          path(pen, [0, run.fence_height_m ?? 0].map((up) => this.place(...p, up)), ink.hit, 1, [6, 4]);
      }
      name("N", n0 + half, e0);
      name("E", n0, e0 + half);
      words(pen, `grid ${step} m`, 6, 16, ink.axis);
    }
    below(pen, run) {
      for (const one of run.now)
        if (one.state & FLYING)
          path(pen, [this.place(one.north, one.east, one.up), this.place(one.north, one.east, 0)],
            ink.faint, 1);
      super.below(pen, run);
    }
  }

  // Middle and half the size of points (north, east, up).
  function box(points) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const point of points)
      for (let c = 0; c < 3; c++)
        if (!Number.isNaN(point[c])) {
          low[c] = Math.min(low[c], point[c]);
          high[c] = Math.max(high[c], point[c]);
        }
    if (!Number.isFinite(low[0])) return [[0, 0, 0], [1, 1, 1]];
    return [low.map((x, c) => (x + high[c]) / 2), low.map((x, c) => Math.max((high[c] - x) / 2, 0.5))];
  }

  const reached = () => box(runs.flatMap((run) => {
    const points = [];
    for (let at = 0; at < run.places.length; at += 3)
      points.push([run.places[at], run.places[at + 1], -run.places[at + 2]]);
    for (const target of run.targets) points.push(...target.at.map(([n, e, d]) => [n, e, -d]));
    return points;
  }));
  let extent = reached();

  // ---- curves over time: drawn anew when their size changes, under a cursor that moves

  function curves() {
    const { pen, width, height } = fitted(part("curves"));
    const x = (t) => (t - first) / (last - first) * width;
    const half = height / 2, head = 26, foot = 5;
    const strip = (name, top, share, levels, values, bounds = []) => {
      const y = (value) => top + head + (half - head - foot) * (1 - clamp(share(value), 0, 1));
      for (const value of levels) {
        path(pen, [[0, y(value)], [width, y(value)]], ink.grid, 1);
        words(pen, `${value}`, 4, y(value) - 2, ink.axis);
      }
      for (const value of bounds) path(pen, [[0, y(value)], [width, y(value)]], ink.hit, 1, [4, 3]);
      for (const run of runs) {
        const points = Array.from(values(run.curve), (value, k) => [
          Number.isNaN(value) ? NaN : x(run.curve.times[k]), y(value)]);
        path(pen, points, several ? colour(run, 0) : ink.ink, 1.3);
      }
      words(pen, name, 4, top + 13);
    };
    const most = (values) => Math.max(...runs.map((run) => values(run.curve).reduce(
      (high, value) => (value > high ? value : high), 0)));
    const error = (curve) => curve.error, near = (curve) => curve.near;
    const worst = Math.max(most(error), 1), decades = Math.log10(worst / 0.01);
    strip("formation error [m]", 0, (value) => Math.log10(Math.max(value, 0.01) / 0.01) / decades,
      [0.01, 0.1, 1, 10, 100, 1000].filter((value) => value <= worst), error);
    const far = Math.max(most(near), runs[0].r_in_m) * 1.05, step = tick(far / 2.5), levels = [];
    for (let value = 0; value < far; value += step) levels.push(Number(value.toPrecision(4)));
    strip("distance of the nearest pair [m]; dashed: r_in", half, (value) => value / far, levels,
      near, [...new Set(runs.map((run) => run.r_in_m))]);
    path(pen, [[0, half], [width, half]], ink.faint, 1);
  }

  // ---- values at the cursor

  const rows = runs.map((run) => {
    const row = part("now").insertRow();
    const name = row.appendChild(make("th"));
    name.scope = "row";
    if (several) name.append(make("i", "", "swatch"), run.name);
    const cells = Array.from({ length: 4 }, () => row.insertCell());
    return { run, row, cells, swatch: name.querySelector(".swatch") };
  });
  if (!several) root.querySelector(".now").classList.add("one");

  const stepAt = (run) => run.steps.findLast((step) => step.t <= time + 1e-3)?.text || "-";

  function tell() {
    for (const { run, cells } of rows) {
      const { times, near, error, pairs } = run.curve;
      let k = before(times, time);
      if (k + 1 < times.length && times[k + 1] - time < time - times[k]) k++;
      const inside = time >= times[0] - 0.1 && time <= times.at(-1) + 0.1;
      const known = (value, text) => (inside && !Number.isNaN(value) ? text : "-");
      const [a, b] = [pairs[2 * k], pairs[2 * k + 1]].map((i) => run.agents[i]).sort((x, y) => x - y);
      cells[0].textContent = `${time.toFixed(1)} s`;
      cells[1].textContent = stepAt(run);
      cells[2].textContent = known(error[k], `${error[k].toFixed(2)} m`);
      cells[3].textContent = known(near[k], `${a}-${b}: ${near[k].toFixed(2)} m`);
      cells[3].className = near[k] < run.r_in_m ? "hit" : near[k] < run.r_out_m ? "near" : "";
    }
  }

  // ---- the line of time

  const slider = part("time"), cursor = part("cursor");
  const share = (t) => `${(clamp((t - first) / (last - first), 0, 1) * 100).toFixed(3)}%`;
  const jumps = [], stepButtons = [];
  let events = [];

  function go(t) {
    time = clamp(t, first, last);
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${time.toFixed(1)} s, ${stepAt(runs[0])}`);
    cursor.style.left = share(time);
    part("newest").classList.toggle("on", time >= last);
    for (const { button, start, end } of stepButtons)
      button.classList.toggle("on", start <= time + 1e-3 && time < end);
    paint();
  }

  function jump(kind, t, text) {
    const button = make("button");
    button.type = "button";
    button.className = kind;
    button.title = text;
    button.setAttribute("aria-label", text);
    button.addEventListener("click", () => go(t));
    jumps.push({ button, t });
    return button;
  }

  function addSteps(run) {
    const row = part("steps").appendChild(make("div", "", "row"));
    run.steps.forEach((step, k) => {
      const end = run.steps[k + 1]?.t;
      const whose = several ? `${run.name}: ` : "";
      const button = jump("", step.t, `${whose}${step.text}, from ${step.t.toFixed(1)} s`);
      button.textContent = step.text;
      if (several) button.style.borderLeftColor = flight.colours[run.k % flight.colours.length];
      row.append(button);
      stepButtons.push({ button, start: step.t, end: end ?? Infinity, run });
    });
  }

  // Marks closer than a mark is wide are one, as bad as its worst.
  function addMarks() {
    const told = runs.flatMap((run) => run.marks.map((mark) => ({
      ...mark, said: `${mark.t.toFixed(1)} s  ${several ? `${run.name}: ` : ""}${mark.text}`,
    }))).sort((a, b) => a.t - b.t);
    const groups = [];
    for (const mark of told) {
      const group = groups.at(-1);
      if (group && mark.t - group.t < (last - first) / 100) group.marks.push(mark);
      else groups.push({ t: mark.t, marks: [mark] });
    }
    for (const { t, marks } of groups) {
      const level = ["error", "warning"].find((name) => marks.some((mark) => mark.level === name));
      const lines = marks.slice(0, 12).map((mark) => mark.said);
      if (marks.length > 12) lines.push(`and ${marks.length - 12} more`);
      const button = jump(level || "well", t, lines.join("\n"));
      button.tabIndex = -1; // there may be hundreds: [ and ] go through them
      part("marks").append(button);
    }
    return [...new Set([...groups.map((group) => group.t), ...runs.flatMap(
      (run) => run.steps.map((step) => step.t))])].sort((a, b) => a - b);
  }

  // All that lies on the line of time, made anew.
  function fill() {
    jumps.length = stepButtons.length = 0;
    part("steps").replaceChildren();
    part("marks").replaceChildren();
    runs.forEach(addSteps);
    events = addMarks();
    lay();
  }

  // The same where the line's ends have moved.
  function lay() {
    slider.min = first;
    slider.max = last;
    for (const { button, t } of jumps) button.style.left = share(t);
    for (const { button, start, end, run } of stepButtons) {
      const length = Math.min(end, run.times.at(-1) ?? last) - Math.max(start, first);
      button.style.width = `${Math.max(0, length) / (last - first) * 100}%`;
    }
  }

  // ---- a flight that goes on

  function joined(a, b) {
    const all = new a.constructor(a.length + b.length);
    all.set(a);
    all.set(b, a.length);
    return all;
  }

  // `told` has moments, all of them (`whole`) or those that follow, and what has changed beside.
  function grow(told) {
    const [run] = runs, newest = time >= last, more = unpacked(told, run.zero_s);
    const add = (to, name) => { to[0][name] = told.whole ? to[1][name] : joined(to[0][name], to[1][name]); };
    for (const name of ["times", "places", "away", "states"]) add([run, more], name);
    for (const name of ["times", "near", "error", "pairs"]) add([run.curve, more.curve], name);
    Object.assign(run, { zones: told.zones, homes: told.homes, links: told.links });
    for (const one of told.targets) {
      const known = told.whole ? null : run.targets.find(({ name }) => name === one.name);
      if (known) { known.times.push(...one.times); known.at.push(...one.at); }
    }
    const names = new Set(run.targets.map(({ name }) => name));
    run.targets = told.whole ? told.targets
      : [...run.targets, ...told.targets.filter(({ name }) => !names.has(name))];
    root.hidden = run.times.length < 2;
    if (root.hidden) return;
    span();
    extent = reached();
    if (told.steps) {
      Object.assign(run, { steps: told.steps, marks: told.marks });
      fill();
    } else lay();
    curves();
    go(newest ? last : time);
  }

  // ---- playing

  let playing = false, shown = null;
  function play(on) {
    playing = on;
    if (on && time >= last) go(first);
    part("play").textContent = on ? "\u23F8\uFE0E" : "\u25B6\uFE0E";
    part("play").setAttribute("aria-label", on ? "Pause" : "Play");
    shown = null;
  }

  const views = [];
  function turn(wall) {
    if (playing) {
      if (shown !== null) go(time + (wall - shown) / 1000 * Number(part("speed").value));
      shown = wall;
      if (time >= last) play(false);
    }
    if (fresh && !root.hidden) {
      fresh = false;
      for (const run of runs) sample(run, time);
      for (const view of views) view.draw();
      tell();
    }
    requestAnimationFrame(turn);
  }

  function keys(e) {
    const at = e.target, typed = at.matches("select, input:not([type=range])");
    if (e.ctrlKey || e.altKey || e.metaKey || typed) return;
    const by = e.shiftKey ? 0.1 : 1;
    const does = {
      " ": at.matches("button") ? null : () => play(!playing),
      ArrowLeft: () => go(time - by), ArrowRight: () => go(time + by),
      "[": () => go(events.findLast((t) => t < time - 1e-3) ?? first),
      "]": () => go(events.find((t) => t > time + 1e-3) ?? last),
    }[e.key];
    if (does) { e.preventDefault(); does(); }
  }

  // ---- start

  root.hidden = runs[0].times.length < 2;
  fill();
  views.push(new Plan(part("plan")), new Scene(part("scene")));
  const hue = () => {
    readColours();
    rows.forEach(({ run, swatch }) => { if (swatch) swatch.style.background = colour(run, 0); });
    curves();
    paint();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", hue);
  new ResizeObserver(curves).observe(part("curves"));
  slider.addEventListener("input", () => go(Number(slider.value)));
  part("play").addEventListener("click", () => play(!playing));
  part("before").addEventListener("click", () => keys({ key: "[", target: root, preventDefault() {} }));
  part("next").addEventListener("click", () => keys({ key: "]", target: root, preventDefault() {} }));
  part("curves").addEventListener("click", (e) =>
    go(first + e.offsetX / part("curves").clientWidth * (last - first)));
  for (const name of ["trails", "names", "slots", "links", "follow"])
    part(name).addEventListener("change", paint);
  document.addEventListener("keydown", keys);
  if (!several)
    for (const cell of document.querySelectorAll("td.time[data-s]")) {
      const button = make("button", cell.textContent);
      button.addEventListener("click", () => {
        go(Number(cell.dataset.s));
        root.scrollIntoView({ block: "start" });
      });
      cell.replaceChildren(button);
    }
  part("newest").hidden = !flight.live;
  part("newest").addEventListener("click", () => { play(false); go(last); });
  if (flight.live) root.addEventListener("flown", (e) => grow(e.detail));
  part("about").textContent = flight.live || runs.map((run) =>
    `${several ? `${run.name}: p` : "P"}laces by ${run.by}, kept every ${run.every_s} s and off by at `
    + `most ${(run.off_m * 100).toFixed(1)} cm; discs are r_in (${run.r_in_m} m) wide.`).join(" ");
  hue();
  go(several ? Math.max(first, Math.min(0, last)) : first);
  requestAnimationFrame(turn);
})();
