"use strict";
// The view of a run in three dimensions, drawn by three.js: free surface, solids, links and tank. The viewpoint moves
// only while the reader moves it.

const TURN = 0.1, SIGHT = 30;  // rad for a press of a key; degrees from the lower to the upper edge of the view

// Levels of the heights of all frames, from their differences.
function readHeights(space, frames) {
  const size = space.x.length * space.y.length, levels = new Uint16Array(frames * size);
  for (let f = 0, from = 0; f < frames; f++, from += 2 * size)
    for (let i = 0; i < size; i++) {
      const small = space.heights[from + i] | (space.heights[from + size + i] << 8);
      levels[f * size + i] = (f ? levels[(f - 1) * size + i] : 0) + ((small >>> 1) ^ -(small & 1));
    }
  return levels;
}

class Space {
  constructor(canvas, run) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.camera = new THREE.PerspectiveCamera(SIGHT, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.lamp = new THREE.DirectionalLight(0xffffff, 0.45);
    this.through = false;
    this.take(run);
    this.fit(run.player.tank.zoom ? "device" : "tank");
  }

  // Takes the frames of a run, or newer frames of the same run.
  take(run) {
    this.run = run;
    this.player = run.player;
    this.space = run.player.space;
    this.levels = readHeights(this.space, run.player.t.length);
    if (this.scene) this.scene.traverse((one) => { if (one.geometry) { one.geometry.dispose(); one.material.dispose(); } });
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.AmbientLight(0xffffff, 0.62), this.lamp);
    this.makeSurface();
    this.solids = this.space.solids.map((solid) => this.makeSolid(solid));
    this.links = this.space.lines.map(({ count }) => this.addLines(THREE.Line, new Float32Array(3 * count)));
    this.makeTank();
    return this;
  }

  makeSurface() {
    const { x, y } = this.space, size = x.length * y.length, geometry = new THREE.BufferGeometry();
    for (const name of ["position", "normal", "color"]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * size), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(6 * (x.length - 1) * (y.length - 1)), 1));
    const places = geometry.attributes.position.array;
    for (let i = 0; i < size; i++) { places[3 * i] = x[Math.floor(i / y.length)]; places[3 * i + 1] = y[i % y.length]; }
    const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide, transparent: true, opacity: 0.86 });
    this.surface = new THREE.Mesh(geometry, material);
    this.surface.frustumCulled = false;
    this.scene.add(this.surface);
  }

  makeSolid({ vertices, faces, floats }) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    geometry.computeVertexNormals();
    const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: floats ? 0xd98a3d : 0x9aa0a8, side: THREE.DoubleSide }));
    this.scene.add(mesh);
    return mesh;
  }

  addLines(kind, places, dashed = false) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    const material = dashed ? new THREE.LineDashedMaterial({ dashSize: 0.03, gapSize: 0.02 }) : new THREE.LineBasicMaterial();
    const lines = new kind(geometry, material);
    if (dashed) lines.computeLineDistances();
    lines.frustumCulled = false;
    this.scene.add(lines);
    return lines;
  }

  // Edges of the tank, the still water level at its walls, and the frame of the section that is shown beside the view.
  makeTank() {
    const { x, y, upper, depth } = this.space, [x0, x1, y0, y1, top] = [x[0], x[x.length - 1], y[0], y[y.length - 1], upper[2]];
    const ring = (z) => [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];
    const sides = (a) => a.flatMap((corner, k) => [...corner, ...a[(k + 1) % 4]]);
    const posts = ring(0).flatMap((corner) => [...corner, corner[0], corner[1], top]);
    this.walls = this.addLines(THREE.LineSegments, new Float32Array([...sides(ring(0)), ...sides(ring(top)), ...posts]));
    this.still = depth ? this.addLines(THREE.LineSegments, new Float32Array(sides(ring(depth))), true) : null;
    this.cut = this.addLines(THREE.LineSegments, new Float32Array(sides([[x0, 0, 0], [x1, 0, 0], [x1, 0, top], [x0, 0, top]])));
  }

  // Looks at the whole tank or at the device, obliquely from the side on which y = 0.
  fit(look) {
    const { x, y, upper } = this.space, zoom = look === "device" && this.player.tank.zoom;
    const [a, b] = zoom || [x[0], x[x.length - 1]], width = y[y.length - 1] - y[0];
    this.target = new THREE.Vector3((a + b) / 2, y[0] + width / 2, upper[2] / 2);
    this.radius = Math.hypot(b - a, width, upper[2]) / 2;
    Object.assign(this, { round: 0.55, above: 0.42, far: 1, look });
  }

  turnBy(round, above) {
    this.round += round;
    this.above = Math.min(Math.max(this.above + above, -1.55), 1.55);
  }

  zoomBy(factor) { this.far = Math.min(Math.max(this.far / factor, 0.05), 5); }

  // Moves the view by pixels to the right and downwards.
  panBy(px, py) {
    const metres = 2 * this.camera.position.distanceTo(this.target) * Math.tan(SIGHT * Math.PI / 360) / this.canvas.clientHeight;
    const right = new THREE.Vector3().setFromMatrixColumn(this.camera.matrix, 0), up = new THREE.Vector3().setFromMatrixColumn(this.camera.matrix, 1);
    this.target.addScaledVector(right, -px * metres).addScaledVector(up, py * metres);
  }

  // Draws the run at a time; y: place of the section (m).
  show(t, y, style) {
    const [f, share] = placeAmong(this.player.t, t), next = Math.min(f + 1, this.player.t.length - 1);
    this.setSurface(f, next, share);
    this.solids.forEach((mesh, k) => this.setSolid(mesh, this.space.solids[k], f, next, share));
    this.links.forEach((line, k) => {
      const { count, points } = this.space.lines[k], places = line.geometry.attributes.position;
      for (let i = 0; i < 3 * count; i++) places.array[i] = points[3 * count * f + i] * (1 - share) + points[3 * count * next + i] * share;
      places.needsUpdate = true;
      line.material.color.set(style.text);
    });
    this.walls.material.color.set(style.wall);
    if (this.still) this.still.material.color.set(style.still);
    this.cut.material.color.set(style.mark);
    this.cut.position.y = y;
    this.setCamera(style);
    this.renderer.render(this.scene, this.camera);
  }

  setSurface(f, next, share) {
    const { x, y, low, step, still, range, colours } = this.space, nx = x.length, ny = y.length, size = nx * ny;
    const { position, normal, color } = this.surface.geometry.attributes, index = this.surface.geometry.index;
    const a = this.levels.subarray(f * size, (f + 1) * size), b = this.levels.subarray(next * size, (next + 1) * size);
    const seen = (i) => a[i] !== UNSEEN && b[i] !== UNSEEN, z = position.array;
    let least = Infinity, most = -Infinity, used = 0;
    for (let i = 0; i < size; i++) {
      if (!seen(i)) continue;
      const height = low + step * (a[i] * (1 - share) + b[i] * share);
      least = Math.min(least, height);
      most = Math.max(most, height);
      z[3 * i + 2] = height;
      const place = 3 * Math.round(255 * Math.min(Math.max(0.5 + (height - still) / (2 * range), 0), 1));
      for (let k = 0; k < 3; k++) color.array[3 * i + k] = colours[place + k] / 255;
    }
    // slope between the neighbours that have a height
    const slope = (back, ahead, run) => (run ? (z[3 * ahead + 2] - z[3 * back + 2]) / run : 0);
    for (let p = 0, i = 0; p < nx; p++)
      for (let q = 0; q < ny; q++, i++) {
        if (!seen(i)) continue;
        const west = p > 0 && seen(i - ny) ? 1 : 0, east = p < nx - 1 && seen(i + ny) ? 1 : 0;
        const south = q > 0 && seen(i - 1) ? 1 : 0, north = q < ny - 1 && seen(i + 1) ? 1 : 0;
        const sx = slope(i - west * ny, i + east * ny, x[p + east] - x[p - west]);
        const sy = slope(i - south, i + north, y[q + north] - y[q - south]), long = Math.sqrt(sx * sx + sy * sy + 1);
        normal.array[3 * i] = -sx / long;
        normal.array[3 * i + 1] = -sy / long;
        normal.array[3 * i + 2] = 1 / long;
        if (!east || !north || !seen(i + ny + 1)) continue;
        for (const corner of [i, i + ny, i + ny + 1, i, i + ny + 1, i + 1]) index.array[used++] = corner;
      }
    this.surface.geometry.setDrawRange(0, used);
    for (const one of [position, normal, color, index]) one.needsUpdate = true;
    this.reach = [least - still, most - still];
  }

  setSolid(mesh, { pivot, poses }, f, next, share) {
    const pose = poses ? Array.from({ length: 6 }, (_, j) => poses[6 * f + j] * (1 - share) + poses[6 * next + j] * share) : [0, 0, 0, 0, 0, 0];
    const turn = new THREE.Vector3(...pose.slice(3)), angle = turn.length();
    mesh.position.set(pivot[0] + pose[0], pivot[1] + pose[1], pivot[2] + pose[2]);
    mesh.quaternion.setFromAxisAngle(angle ? turn.divideScalar(angle) : turn.set(0, 0, 1), angle);
    mesh.pose = pose;
    Object.assign(mesh.material, { transparent: this.through, opacity: this.through ? 0.45 : 1, depthWrite: !this.through });
  }

  setCamera(style) {
    const width = Math.max(this.canvas.clientWidth, 1), height = Math.max(this.canvas.clientHeight, 1);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.renderer.setClearColor(style.card);
    const narrow = Math.min(width / height, 1), far = 0.97 * this.far * this.radius / Math.sin(SIGHT * Math.PI / 360) / narrow;
    const across = Math.cos(this.above) * far;
    this.camera.aspect = width / height;
    this.camera.near = far / 100;
    this.camera.far = far * 10;
    this.camera.position.set(-Math.sin(this.round) * across, -Math.cos(this.round) * across, Math.sin(this.above) * far).add(this.target);
    this.camera.lookAt(this.target);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.lamp.position.copy(this.camera.position).add(new THREE.Vector3(0, 0, far));
  }

  // What the picture shows, in words.
  words(t) {
    const three = (value) => number(Number((1000 * value).toPrecision(3))), [least, most] = this.reach.map((value) => `${three(value)} mm`);
    const moved = this.solids.flatMap((mesh, k) => {
      const name = this.space.solids[k].name;
      if (!name) return [];
      const [x, y, z] = mesh.pose.slice(0, 3).map(three), degrees = Math.hypot(...mesh.pose.slice(3)) * 180 / Math.PI;
      return [`${name} moved by (${x}, ${y}, ${z}) mm and turned by ${number(Number(degrees.toPrecision(3)))}°`];
    });
    return `At t = ${t.toFixed(2)} s: free surface from ${least} to ${most} relative to the still water level${moved.length ? `; ${moved.join("; ")}` : ""}.`;
  }
}

// Turning, zooming and moving by mouse, finger and keys, while the view has the focus.
function steer(canvas, space) {
  gestures(canvas, (px, py, event) => { if (event.shiftKey) space.panBy(px, py); else space.turnBy(0.008 * px, 0.008 * py); }, (by) => space.zoomBy(by));
  canvas.addEventListener("keydown", (event) => {
    const does = {
      ArrowLeft: () => space.turnBy(-TURN, 0), ArrowRight: () => space.turnBy(TURN, 0), ArrowUp: () => space.turnBy(0, TURN),
      ArrowDown: () => space.turnBy(0, -TURN), "+": () => space.zoomBy(1.2), "-": () => space.zoomBy(1 / 1.2), 0: () => space.fit("tank"),
    }[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    does();
    event.preventDefault();
    event.stopPropagation();
    show();
  });
}

// The view of a run with its legend, buttons and description; a sentence if it cannot be drawn.
function spaceStage(run, known) {
  if (!run.player.space || !window.THREE) return el("p", { class: "hint" }, run.player.missing || "The view in three dimensions is not in this page.");
  let space = known;
  try {
    if (space) space.take(run);
    else {
      const canvas = el("canvas", { class: "space", role: "img", tabindex: "0" });
      space = new Space(canvas, run);
      steer(canvas, space);
    }
  } catch (error) {
    return el("p", { class: "hint" }, `The view in three dimensions needs a browser with WebGL (${error.message}).`);
  }
  page.spaces.push(space);
  space.told = el("p", { class: "hint" });
  space.label = `Free surface and solids of ${run.label} in three dimensions, coloured by elevation. Arrow keys turn the view, plus and minus zoom.`;
  const press = (text, label, does) => el("button", { type: "button", "aria-label": label, onclick: () => { does(); show(); } }, text);
  const through = el("input", { type: "checkbox", onchange: () => { space.through = through.checked; show(); } });
  through.checked = space.through;
  const bar = el("canvas", { width: 256, height: 1, role: "img", "aria-label": "Scale of the elevations" });
  paint(bar, run.player.space.colours);
  const range = Number(run.player.space.range.toPrecision(2));
  return el("div", {}, space.canvas,
    el("div", { class: "controls" }, press("←", "Turn the view to the left", () => space.turnBy(-TURN, 0)), press("→", "Turn the view to the right", () => space.turnBy(TURN, 0)),
      press("↑", "Look from further above", () => space.turnBy(0, TURN)), press("↓", "Look from further below", () => space.turnBy(0, -TURN)),
      press("−", "Zoom the view out", () => space.zoomBy(1 / 1.2)), press("+", "Zoom the view in", () => space.zoomBy(1.2)),
      press("Whole", "Look at the whole tank obliquely", () => space.fit("tank")), el("label", {}, through, " see through solids")),
    el("div", { class: "legend" }, el("span", {}, "elevation (m)"), el("span", {}, number(-range)), bar, el("span", {}, number(range))), space.told);
}

// Draws the 256 colours of a scale.
function paint(bar, colours) {
  const context = bar.getContext("2d"), image = context.createImageData(256, 1);
  for (let k = 0; k < 256; k++) image.data.set([colours[3 * k], colours[3 * k + 1], colours[3 * k + 2], 255], 4 * k);
  context.putImageData(image, 0, 0);
}
