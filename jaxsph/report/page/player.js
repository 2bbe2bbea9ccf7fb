"use strict";
// Particles played back: every picture is made in memory, without the graphics card, so that it looks the same
// on every machine.

const UNSEEN = 65535;

class Water {
  constructor(canvas, run) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.take(run);
    this.look = this.player.tank.zoom ? "device" : "tank";
    this.show = this.show.bind(this);
  }

  // Takes the frames of a run, or newer frames of the same run.
  take(run) {
    this.player = run.player;
    this.frames = readFrames(run.player);
    this.view = this.view || null;
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.canvas.width !== width || this.canvas.height !== height || !this.image) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.image = this.context.createImageData(width, height);
      this.pixels = new Uint32Array(this.image.data.buffer);
      if (!this.moved) this.fit(this.look);
    }
  }

  // Sets the view to the whole tank or the device: x of the left edge (m), z of the lower edge (m), pixels per metre.
  fit(look) {
    const tank = this.player.tank, { width, height } = this.canvas;
    const [a, b] = look === "device" && tank.zoom ? tank.zoom : [tank.x0 - 0.03, tank.x1 + 0.03];
    const low = -0.04 * tank.top, high = tank.top;
    const scale = Math.min(width / (b - a), height / (high - low));
    this.look = look;
    this.moved = false;
    this.view = { x: (a + b - width / scale) / 2, z: (low + high - height / scale) / 2, scale };
  }

  zoomBy(factor, px = this.canvas.width / 2, py = this.canvas.height / 2) {
    const view = this.view, scale = Math.min(Math.max(view.scale * factor, 5), 1e5);
    const up = this.canvas.height - py;
    view.x += px / view.scale - px / scale;
    view.z += up / view.scale - up / scale;
    view.scale = scale;
    this.moved = true;
  }

  panBy(px, py) {
    this.view.x -= px / this.view.scale;
    this.view.z += py / this.view.scale;
    this.moved = true;
  }

  colours(name, dark) {
    const field = this.frames.fields[name], table = new Uint32Array(256);
    for (let k = 0; k < 256; k++)
      table[k] = 0xff000000 | (field.colours[3 * k + 2] << 16) | (field.colours[3 * k + 1] << 8) | field.colours[3 * k];
    return table;
  }

  // Draws the water at a time, coloured by a field.
  show(t, name, style) {
    this.resize();
    const { player, view, pixels } = this, { count, low, high } = player, times = player.t;
    const { width, height } = this.canvas, { places } = this.frames, { levels } = this.frames.fields[name];
    const [f, share] = placeAmong(times, t), last = times.length - 1;
    const rows = [Math.max(f - 1, 0), f, Math.min(f + 1, last), Math.min(f + 2, last)];
    // Catmull and Rom's spline through four frames, so that waves keep their height between frames
    const s = share, weights = [
      -0.5 * s + s * s - 0.5 * s * s * s, 1 - 2.5 * s * s + 1.5 * s * s * s,
      0.5 * s + 2 * s * s - 1.5 * s * s * s, -0.5 * s * s + 0.5 * s * s * s];
    const [b0, b1, b2, b3] = rows.map((row) => 2 * row * count), [w0, w1, w2, w3] = weights;
    const unitX = (high[0] - low[0]) / 65534 * view.scale, unitZ = (high[1] - low[1]) / 65534 * view.scale;
    const left = (low[0] - view.x) * view.scale, base = height - (low[1] - view.z) * view.scale;
    const table = this.colours(name), level0 = rows[1] * count, level1 = rows[2] * count;
    const size = Math.max(1.12 * player.dx * view.scale, 1.6), round = size > 5, radius = size / 2;
    pixels.fill(style.back);
    let drawn = 0;
    for (let i = 0; i < count; i++) {
      const x1 = places[b1 + i], x2 = places[b2 + i];
      if (x1 === UNSEEN || x2 === UNSEEN) continue;
      const z1 = places[b1 + count + i], z2 = places[b2 + count + i];
      let x0 = places[b0 + i], x3 = places[b3 + i], z0 = places[b0 + count + i], z3 = places[b3 + count + i];
      if (x0 === UNSEEN) { x0 = x1; z0 = z1; }
      if (x3 === UNSEEN) { x3 = x2; z3 = z2; }
      const px = left + unitX * (w0 * x0 + w1 * x1 + w2 * x2 + w3 * x3);
      const py = base - unitZ * (w0 * z0 + w1 * z1 + w2 * z2 + w3 * z3);
      if (px < -size || py < -size || px > width + size || py > height + size) continue;
      drawn++;
      const colour = table[(levels[level0 + i] * (1 - s) + levels[level1 + i] * s + 0.5) | 0];
      const top = Math.max(0, Math.round(py - radius)), end = Math.min(height, Math.round(py + radius));
      for (let row = top; row < end; row++) {
        let half = radius;
        if (round) {
          const off = row + 0.5 - py;
          half = Math.sqrt(Math.max(radius * radius - off * off, 0));
        }
        const from = Math.max(0, Math.round(px - half)), to = Math.min(width, Math.round(px + half));
        const line = row * width;
        for (let k = line + from; k < line + to; k++) pixels[k] = colour;
      }
    }
    this.context.putImageData(this.image, 0, 0);
    this.solids(f, s, style);
    return drawn;
  }

  solids(f, share, style) {
    const { tank, t } = this.player, context = this.context, view = this.view, height = this.canvas.height;
    const X = (x) => (x - view.x) * view.scale, Z = (z) => height - (z - view.z) * view.scale;
    const next = Math.min(f + 1, t.length - 1);
    const between = (values, k) => values[k(f)] * (1 - share) + values[k(next)] * share;
    const box = (x0, z0, x1, z1) => context.fillRect(X(x0), Z(z1), X(x1) - X(x0), Z(z0) - Z(z1));
    context.fillStyle = style.wall;
    const thick = 0.03 * tank.top + 0.01, roof = tank.top, [left, right, below] = tank.walls;
    if (below) box(tank.x0 - 0.5, -thick, tank.x1 + 0.5, 0);
    if (left) box(tank.x0 - thick, -thick, tank.x0, roof);
    if (right) box(tank.x1, -thick, tank.x1 + thick, roof);
    for (const { corners, pivot, poses } of tank.solids) {
      const [dx, dz, angle] = poses ? [0, 1, 2].map((j) => between(poses, (k) => 3 * k + j)) : [0, 0, 0];
      const c = Math.cos(angle), sn = Math.sin(angle);
      context.beginPath();
      for (const [x, z] of corners) {
        const a = x - pivot[0], b = z - pivot[1];
        context.lineTo(X(c * a + sn * b + pivot[0] + dx), Z(-sn * a + c * b + pivot[1] + dz));
      }
      context.closePath();
      context.fill();
    }
    for (const [width, colour] of [[4, style.halo], [1.8, style.wall]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      for (const { count, points } of tank.lines) {
        context.beginPath();
        for (let i = 0; i < count; i++) {
          const [x, z] = [0, 1].map((j) => between(points, (k) => 2 * (count * k + i) + j));
          context.lineTo(X(x), Z(z));
        }
        context.stroke();
      }
    }
    if (tank.depth) {
      context.strokeStyle = style.still;
      context.setLineDash([8, 6]);
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(X(tank.x0), Z(tank.depth));
      context.lineTo(X(tank.x1), Z(tank.depth));
      context.stroke();
      context.setLineDash([]);
    }
  }
}
