  // The 3D scene: decoding of points, free view and camera views, and drawing of one frame.
  const element = (id) => document.getElementById(id);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  function bytesOf(text) {
    const characters = atob(text), bytes = new Uint8Array(characters.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
    return bytes;
  }
  const K = scene.keypoints.length, nFrames = scene.frames.length, several = scene.people.length !== 1;

  function unpack(text) {
    const bytes = bytesOf(text), steps = new DataView(bytes.buffer), out = new Float32Array(bytes.length / 2);
    for (let i = 0; i < out.length; i++) {
      const step = steps.getInt16(2 * i, true);
      out[i] = step === -32768 ? NaN : scene.origin[i % 3] + step * scene.step;
    }
    return out;
  }
  const layers = scene.layers.map(({ name, points }) => ({ name, points: points.map(unpack) }));
  const truth = scene.truth ? scene.truth.map(unpack) : null;
  const covariances = scene.covariances.map(bytesOf);
  const marks = scene.marks.map(bytesOf);
  const markBytes = (scene.markedViews ? scene.cameras.length || 1 : 0) + 1 + 3 >> 2;
  // Two bits each: first the state of the point, then of its detection in each view.
  const mark = (person, frame, k, slot) => {
    const at = (frame * K + k) * markBytes + (slot >> 2);
    return marks[person][at] >> 2 * (slot & 3) & 3;
  };
  const at = (points, frame, k) => {
    const i = (frame * K + k) * 3;
    return Number.isFinite(points[i]) ? [points[i], points[i + 1], points[i + 2]] : null;
  };

  // The scene of a calibration whose up axis is unknown is shown upright, but has no ground.
  const upright = scene.up || scene.shownUp || "", upAxis = upright.replace("-", "");
  const upIndex = "xyz".indexOf(upAxis) >= 0 && upAxis ? "xyz".indexOf(upAxis) : 2, upSign = upright.startsWith("-") ? -1 : 1;
  const isPlanar = scene.unit !== "m";
  // Hands and faces: their keypoints are close to each other, so they are drawn thin and small.
  const fine = new Set(scene.bodies?.fine), isFine = ([a, b]) => fine.has(a) || fine.has(b);
  let colors = {};
  function readColors() {
    const names = ["ink", "faint", "line", "paper", "left", "right", "middle", "truth", "floor", "target", "skin"];
    colors = Object.fromEntries(names.map((name) => [name, css(`--${name}`)]));
    colors.people = scene.people.map((_, i) => css(`--person-${i % 10}`));
    colors.cameras = scene.cameras.map((_, i) => scene.volume ? css(`--person-${i % 10}`) : colors.faint);
  }
  readColors();
  const sideOf = ([a, b]) => {
    const of = [scene.sides[a], scene.sides[b]];
    return of[0] === of[1] ? of[0] : of.includes("left") && !of.includes("right") ? "left"
      : of.includes("right") && !of.includes("left") ? "right" : "middle";
  };
  const edgeSides = scene.edges.map(sideOf);
  const keypointColor = (person, k) => several ? colors.people[person] : colors[scene.sides[k]];
  const edgeColor = (person, e) => several ? colors.people[person] : colors[edgeSides[e]];

  // Bounds of the people over all frames, which the free view initially shows.
  function extent() {
    const all = [[], [], []], stride = Math.max(1, Math.floor(nFrames * K / 20000));
    for (const points of layers[0].points) for (let i = 0; i < points.length; i += 3 * stride) {
      if (Number.isFinite(points[i])) for (let j = 0; j < 3; j++) all[j].push(points[i + j]);
    }
    return all.map((values) => {
      values.sort((a, b) => a - b);
      return values.length ? [values[Math.floor(0.01 * (values.length - 1))], values[Math.ceil(0.99 * (values.length - 1))]] : [-1, 1];
    });
  }
  const bounds = extent();
  const centerOf = (ranges) => ranges.map(([a, b]) => (a + b) / 2);
  const size = Math.max(...bounds.map(([a, b]) => b - a)) || 1;
  const radiusOf = (ranges) => Math.hypot(...ranges.map(([a, b]) => b - a)) / 2 || 1;
  const boundsWithCameras = bounds.map((range, i) => scene.cameras.reduce(
    ([low, high], { center }) => [Math.min(low, center[i]), Math.max(high, center[i])], range));

  // The free view: a viewpoint on a sphere around a target; turn about the up axis, tilt above the ground.
  const state = { frame: 0, camera: -1, follow: -1, layer: 0, sideBySide: false, covariances: false, truth: true, trails: true, marked: null, zoom: { scale: 1, center: null },
    turn: 0.9, tilt: 0.35, distance: 0, target: centerOf(bounds), wide: false };
  const FOCAL = 1.5;
  function fitView(wide) {
    const ranges = wide ? boundsWithCameras : bounds;
    state.wide = wide;
    state.target = centerOf(ranges);
    if (isPlanar) { state.turn = 0; state.tilt = 0; }
    // The smallest distance at which all corners of the bounding box are in the image.
    const { right, down, ahead } = axesOf(), corners = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => ranges.map((range, i) => range[(bits >> i) & 1]));
    const needed = corners.map((corner) => minus(corner, state.target)).map(
      (d) => Math.max(1.53 * FOCAL * Math.abs(dot(d, down)), 1.1 * FOCAL * Math.abs(dot(d, right))) - dot(d, ahead));
    state.distance = Math.max(1.35 * FOCAL * radiusOf(ranges) * (wide ? 1.1 : 1), ...needed);
  }

  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };
  function axesOf() {
    const up = [0, 0, 0];
    up[upIndex] = upSign;
    if (isPlanar) return { right: [1, 0, 0], down: [0, 1, 0], ahead: [0, 0, 1] };
    const one = [0, 0, 0];
    one[(upIndex + 1) % 3] = 1;
    const other = cross(up, one), c = Math.cos(state.tilt), s = Math.sin(state.tilt);
    const back = [0, 1, 2].map((i) => c * (Math.cos(state.turn) * one[i] + Math.sin(state.turn) * other[i]) + s * up[i]);
    const ahead = back.map((v) => -v), right = unit(cross(ahead, up));
    return { right, down: cross(ahead, right), ahead };
  }
  fitView(Boolean(scene.volume));

  // A pane is a part of the canvas; its projection maps a point to x, y and depth, or null.
  function freeProjection(pane) {
    const { right, down, ahead } = axesOf(), eye = state.target.map((v, i) => v - state.distance * ahead[i]);
    const scale = FOCAL * Math.min(pane.width, 1.4 * pane.height) / 2;
    return (p) => {
      const d = minus(p, eye), z = dot(d, ahead);
      if (!(z > 0.02 * state.distance)) return null;
      return [pane.x + pane.width / 2 + scale * dot(d, right) / z, pane.y + pane.height / 2 + scale * dot(d, down) / z, z];
    };
  }
  function cameraProjection(camera, pane) {
    const [width, height] = camera.size, scale = state.zoom.scale * 0.94 * Math.min(pane.width / width, pane.height / height);
    const [x, y] = state.zoom.center || [width / 2, height / 2];
    const x0 = pane.x + pane.width / 2 - scale * x, y0 = pane.y + pane.height / 2 - scale * y;
    state.zoom.pixels = scale;
    const to = (p) => {
      const pixel = projectThrough(camera, p);
      return pixel && [x0 + scale * (pixel[0] + 0.5), y0 + scale * (pixel[1] + 0.5), pixel[2]];
    };
    to.image = [x0, y0, scale * width, scale * height];
    return to;
  }

  const canvas = element("canvas"), context = canvas.getContext("2d");
  let dots = [], solids = null;
  function draw() {
    const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    dots = [];
    followPerson();
    solids?.begin(width, height);
    drawPanes(width, height);
    // Printed pages show one canvas only.
    if (isPaper()) solids?.underlay(context, width, height);
  }
  function drawPanes(width, height) {
    if (!state.sideBySide) return drawPane({ x: 0, y: 0, width, height }, layers[state.layer], layers.length > 1);
    const tall = width < 600, half = tall ? height / 2 : width / 2, other = layers[(state.layer + 1) % layers.length];
    const panes = [0, 1].map((i) => tall ? { x: 0, y: i * half, width, height: half } : { x: i * half, y: 0, width: half, height });
    drawPane(panes[0], layers[state.layer], true);
    drawPane(panes[1], other, true);
    context.strokeStyle = colors.line;
    context.strokeRect(panes[1].x, panes[1].y, panes[1].width, panes[1].height);
  }
  function followPerson() {
    if (state.follow < 0) return;
    const center = personCenter(state.follow);
    if (center) state.target = center;
    const pixel = center && state.camera >= 0 && projectThrough(scene.cameras[state.camera], center);
    if (pixel) state.zoom.center = [pixel[0], pixel[1]];
  }
  // Zoom the camera view to a person.
  function zoomToPerson(person) {
    const camera = scene.cameras[state.camera], points = layers[state.layer].points[person], xs = [], ys = [];
    for (let k = 0; k < K; k++) {
      const p = at(points, state.frame, k), pixel = p && projectThrough(camera, p);
      if (pixel) { xs.push(pixel[0]); ys.push(pixel[1]); }
    }
    if (!xs.length) return;
    const span = (values, whole) => (Math.max(...values) - Math.min(...values)) / whole;
    const share = Math.max(span(xs, camera.size[0]), span(ys, camera.size[1]), 0.02);
    state.zoom.scale = Math.max(1, Math.min(12, 0.6 / share));
    state.zoom.center = [xs, ys].map((values) => (Math.max(...values) + Math.min(...values)) / 2);
  }
  const personCenter = (person) => centerAt(layers[state.layer].points[person], state.frame);
  function centerAt(points, frame) {
    const sum = [0, 0, 0];
    let n = 0;
    for (let k = 0; k < K; k++) {
      const p = at(points, frame, k);
      if (p) { n++; for (let i = 0; i < 3; i++) sum[i] += p[i]; }
    }
    return n ? sum.map((v) => v / n) : null;
  }

  function drawPane(pane, layer, named) {
    const camera = state.camera >= 0 ? scene.cameras[state.camera] : null;
    const to = camera ? cameraProjection(camera, pane) : freeProjection(pane);
    context.save();
    context.beginPath();
    context.rect(pane.x, pane.y, pane.width, pane.height);
    context.clip();
    const strokes = [], solid = solids && !camera;
    if (solid) solids.draw(pane, layer);
    if (!isPlanar && scene.up && !solid) strokes.push(...ground(to));
    if (camera) frameOfImage(to.image);
    else if (!solid) scene.cameras.forEach((each, i) => strokes.push(...frustum(each, to, colors.cameras[i])));
    if (scene.volume && !camera) scene.cameras.forEach((each, i) => fieldOfView(each, to, colors.cameras[i]));
    if (scene.volume) layer.points.forEach((points) => strokes.push(...trace(points, to)));
    if (truth && state.truth) truth.forEach((points) => strokes.push(...bones(points, to, () => several ? colors.faint : colors.truth, 2.5)));
    if (!solid) layer.points.forEach((points, person) => strokes.push(...bones(points, to, (e) => edgeColor(person, e), 4)));
    strokes.sort((a, b) => b.depth - a.depth).forEach(stroke);
    if (state.covariances && scene.volume) volumeDots(to);
    else if (state.covariances && layer === layers[0]) layer.points.forEach((points, person) => ellipsoids(points, person, to));
    layer.points.forEach((points, person) => keypoints(points, person, to, camera, solid));
    if (!camera) scene.cameras.forEach((each, i) => label(each.name, to(each.center), colors.cameras[i], 12));
    if (several) layer.points.forEach((points, person) => label(scene.people[person], head(points, to), colors.people[person], 13));
    if (scene.up && !camera && !scene.volume) label(`grid ${lengthText(cell)}`, [pane.x + 8, pane.y + pane.height - 10], colors.ink, 12, "left");
    label([named ? `layer ${layer.name}` : "", camera ? camera.name : ""].filter(Boolean).join(", "), [pane.x + 8, pane.y + 18], colors.ink, 13, "left");
    context.restore();
  }
  function stroke({ from, to, color, width }) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.lineCap = "round";
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.stroke();
  }
  const segment = (from, to, color, width, behind = 0) => from && to ? [{ from, to, color, width, depth: (from[2] + to[2]) / 2 + behind }] : [];
  const bones = (points, to, color, width) => scene.edges.flatMap(([a, b], e) => {
    const p = at(points, state.frame, a), q = at(points, state.frame, b);
    return p && q ? segment(to(p), to(q), color(e), isFine([a, b]) ? 1.2 : width) : [];
  });
  function frustum({ center, corners }, to, color) {
    const c = to(center), q = corners.map(to);
    return [0, 1, 2, 3].flatMap((i) => [...segment(c, q[i], color, 1), ...segment(q[i], q[(i + 1) % 4], color, i ? 1 : 2.5)]);
  }
  function fieldOfView({ center, corners }, to, color) {
    const c = to(center), q = corners.map(to);
    if (!c || q.includes(null)) return;
    context.fillStyle = color;
    context.globalAlpha = 0.07;
    for (const side of [[c, q[0], q[1]], [c, q[1], q[2]], [c, q[2], q[3]], [c, q[3], q[0]], q]) {
      context.beginPath();
      side.forEach(([x, y]) => context.lineTo(x, y));
      context.fill();
    }
    context.globalAlpha = 1;
  }
  // All poses of a calibration's target, behind the one of the current frame.
  function trace(points, to) {
    const out = [];
    for (let frame = 0; frame < nFrames; frame++) for (const [a, b] of scene.edges) {
      const p = at(points, frame, a), q = at(points, frame, b);
      if (p && q) out.push(...segment(to(p), to(q), colors.faint, 0.4, 1e3));
    }
    return out;
  }
  // Places in the filmed volume of a calibration, colored by the standard deviation of points there.
  const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  function viridis(share) {
    const x = Math.max(0, Math.min(0.999, share)) * (VIRIDIS.length - 1), i = Math.floor(x);
    return `rgb(${VIRIDIS[i].map((v, j) => Math.round(v + (x - i) * (VIRIDIS[i + 1][j] - v))).join(",")})`;
  }
  function volumeDots(to) {
    const { points, sd, range: [low, high] } = scene.volume;
    context.strokeStyle = colors.faint;
    context.lineWidth = 0.5;
    points.forEach((p, i) => {
      const q = to(p);
      if (!q) return;
      context.fillStyle = viridis((sd[i] - low) / ((high - low) || 1));
      disc(q, 4.5);
    });
  }
  function frameOfImage([x, y, width, height]) {
    context.strokeStyle = colors.faint;
    context.lineWidth = 1;
    context.strokeRect(x, y, width, height);
  }
  // A grid at height 0 if people stand near it, else below the lowest point.
  const steps = [1, 2, 5, 10].map((n) => n * 10 ** Math.floor(Math.log10(size / 6)));
  const cell = steps.find((step) => size / step <= 10) || size;
  const lowest = upSign > 0 ? bounds[upIndex][0] : bounds[upIndex][1];
  const groundAt = Math.abs(lowest) < 0.25 * size ? 0 : lowest;
  function ground(to) {
    const [i, j] = [0, 1, 2].filter((axis) => axis !== upIndex), out = [];
    const from = (axis) => Math.floor((bounds[axis][0] - cell) / cell) * cell, until = (axis) => Math.ceil((bounds[axis][1] + cell) / cell) * cell;
    const point = (a, b) => { const p = [0, 0, 0]; p[i] = a; p[j] = b; p[upIndex] = groundAt; return to(p); };
    for (let a = from(i); a <= until(i) + 1e-9; a += cell) for (let b = from(j); b < until(j) - 1e-9; b += cell)
      out.push(...segment(point(a, b), point(a, b + cell), colors.floor, 1, 1e6));
    for (let b = from(j); b <= until(j) + 1e-9; b += cell) for (let a = from(i); a < until(i) - 1e-9; a += cell)
      out.push(...segment(point(a, b), point(a + cell, b), colors.floor, 1, 1e6));
    return out;
  }
  const FINE_ZOOM = 4;
  function keypoints(points, person, to, camera, solid) {
    for (let k = 0; k < K; k++) {
      const p = at(points, state.frame, k), q = p && to(p);
      if (!q) continue;
      dots.push({ x: q[0], y: q[1], person, k, p });
      const small = fine.has(k), radius = small ? 1 : 3.2, color = keypointColor(person, k), hollow = mark(person, state.frame, k, 0) === 2;
      context.lineWidth = small ? 0.6 : 1.5;
      context.strokeStyle = color;
      context.fillStyle = hollow ? colors.paper : color;
      if (!solid || hollow) disc(q, radius);
      if (scene.labeled) label(scene.keypoints[k].replace(/^\D+/, ""), [q[0] + 6, q[1] - 5], colors.ink, 11, "left");
      // Marks would cover hands and faces; there is space for them when zoomed in.
      if (camera && scene.markedViews && (!small || state.zoom.scale > FINE_ZOOM)) viewMark(q, mark(person, state.frame, k, 1 + state.camera), radius + 2.5);
      const m = state.marked;
      if (m && m.keypoint === k && (m.person === undefined || m.person === person)) {
        context.strokeStyle = colors.ink;
        context.lineWidth = 2;
        ring(q, 11);
        label(scene.keypoints[k], [q[0] + 15, q[1] + 4], colors.ink, 13, "left");
      }
    }
  }
  function disc(q, radius) { context.beginPath(); context.arc(q[0], q[1], radius, 0, 7); context.fill(); context.stroke(); }
  function ring(q, radius) { context.beginPath(); context.arc(q[0], q[1], radius, 0, 7); context.stroke(); }
  function viewMark(q, code, r) {
    context.strokeStyle = colors.ink;
    context.lineWidth = 0.8;
    if (code === 1) ring(q, r);
    if (code === 2) {
      context.lineWidth = 2;
      for (const s of [1, -1]) { context.beginPath(); context.moveTo(q[0] - r, q[1] - s * r); context.lineTo(q[0] + r, q[1] + s * r); context.stroke(); }
    }
  }
  const lengthText = (m) => m >= 1 ? `${+m.toPrecision(2)} m` : m >= 0.01 ? `${+(100 * m).toPrecision(2)} cm` : `${+(1000 * m).toPrecision(2)} mm`;
  function label(text, q, color, height, align = "center") {
    if (!q || !text) return;
    context.font = `${height / 16}rem system-ui, sans-serif`;
    context.textAlign = align;
    context.lineWidth = 3;
    context.strokeStyle = colors.paper;
    context.strokeText(text, q[0], q[1]);
    context.fillStyle = color;
    context.fillText(text, q[0], q[1]);
  }
  // Position of the name: slightly above the highest point of a person.
  function head(points, to) {
    let best = null;
    for (let k = 0; k < K; k++) {
      const p = at(points, state.frame, k);
      if (p && (!best || upSign * (p[upIndex] - best[upIndex]) > 0)) best = p;
    }
    if (!best) return null;
    best[upIndex] += 0.08 * upSign * Math.min(size, 2);
    return to(best);
  }
  // The 68 % region of a 3D normal distribution extends to 1.878 standard deviations.
  const ELLIPSOID_SCALE = 1.878;
  function ellipsoids(points, person, to) {
    const codes = covariances[person];
    for (let k = 0; k < K; k++) {
      const p = at(points, state.frame, k), i = (state.frame * K + k) * 7;
      if (!p || !codes[i]) continue;
      const s = ELLIPSOID_SCALE * 1e-6 * 1e9 ** ((codes[i] - 1) / 254) / 127;
      const [a, b, c, d, e, f] = Array.from({ length: 6 }, (_, j) => s * (codes[i + 1 + j] << 24 >> 24));
      const on = (x, y, z) => [p[0] + a * x, p[1] + b * x + d * y, p[2] + c * x + e * y + f * z];
      context.strokeStyle = keypointColor(person, k);
      context.lineWidth = 0.8;
      for (const circle of [(u, v) => on(u, v, 0), (u, v) => on(u, 0, v), (u, v) => on(0, u, v)]) {
        context.beginPath();
        for (let n = 0; n <= 24; n++) {
          const q = to(circle(Math.cos(n * Math.PI / 12), Math.sin(n * Math.PI / 12)));
          if (q) context.lineTo(q[0], q[1]);
        }
        context.stroke();
      }
    }
  }
