  // The first frame and viewpoint: most people and keypoints exist, no camera is in front of the people, and they overlap
  // least. The result depends on the scene only, so that a page always opens in the same way.
  function fullestFrame() {
    let best = 0, most = [-1, -1];
    for (let frame = 0; frame < nFrames; frame++) {
      const counts = layers[0].points.map((points) => countPoints(points, frame));
      const people = counts.filter(Boolean).length, points = counts.reduce((a, b) => a + b, 0);
      if (people > most[0] || people === most[0] && points > most[1]) { best = frame; most = [people, points]; }
    }
    return best;
  }
  function countPoints(points, frame) {
    let n = 0;
    for (let k = 0; k < K; k++) n += Number.isFinite(points[(frame * K + k) * 3]);
    return n;
  }
  // The rectangle on the screen around points, with their smallest depth; null if a point cannot be projected.
  function screenBox(points, to) {
    const box = { left: Infinity, right: -Infinity, top: Infinity, bottom: -Infinity, depth: Infinity };
    for (const p of points) {
      const q = to(p);
      if (!q) return null;
      Object.assign(box, { left: Math.min(box.left, q[0]), right: Math.max(box.right, q[0]), top: Math.min(box.top, q[1]),
        bottom: Math.max(box.bottom, q[1]), depth: Math.min(box.depth, q[2]) });
    }
    return box;
  }
  const widened = (box, share) => {
    const x = share * (box.right - box.left), y = share * (box.bottom - box.top);
    return { ...box, left: box.left - x, right: box.right + x, top: box.top - y, bottom: box.bottom + y };
  };
  const areaOf = (box) => Math.max(0, box.right - box.left) * Math.max(0, box.bottom - box.top);
  const common = (a, b) => ({ left: Math.max(a.left, b.left), right: Math.min(a.right, b.right), top: Math.max(a.top, b.top), bottom: Math.min(a.bottom, b.bottom) });
  const overlap = (a, b) => areaOf(common(a, b)) / (Math.min(areaOf(a), areaOf(b)) || 1);

  // The cost of the current viewpoint: how much of the people in a frame it hides.
  function viewCost(people, fronts, pane) {
    const to = freeProjection(pane), { ahead } = axesOf(), eye = state.target.map((v, i) => v - state.distance * ahead[i]);
    const boxes = people.map((points) => screenBox(points, to)).filter(Boolean).map((box) => widened(box, 0.15));
    const whole = { left: pane.x, right: pane.x + pane.width, top: pane.y, bottom: pane.y + pane.height };
    let cost = 0;
    for (const { center, corners } of scene.cameras) {
      const box = screenBox([center, ...corners], to);
      const isPartlyBehind = !box && [center, ...corners].some(to);
      if (isPartlyBehind) cost += 2;
      if (!box) continue;
      const covered = boxes.filter(({ depth }) => box.depth < depth).reduce((sum, person) => sum + Math.min(1, areaOf(common(box, person)) / areaOf(person)), 0);
      // Near cameras beside the people distract less.
      const isNear = dot(minus(center, eye), ahead) < state.distance;
      cost += 10 * covered + (isNear ? 3 * areaOf(common(box, whole)) / areaOf(whole) : 0);
    }
    boxes.forEach((box, i) => boxes.slice(0, i).forEach((other) => { cost += 3 * overlap(box, other); }));
    // Of equally good viewpoints, faces and hands are seen best from the front, and slightly from above.
    const backs = fronts.map((front) => (1 + dot(front, ahead)) / 2);
    return cost + (backs.length ? 0.3 * backs.reduce((a, b) => a + b, 0) / backs.length : 0) + 0.5 * Math.abs(state.tilt - 0.35);
  }
  // The horizontal direction that a person faces, from the keypoints on both sides.
  function frontOf(points, frame) {
    const middle = (side) => {
      const of = scene.sides.flatMap((each, k) => each === side ? [at(points, frame, k)] : []).filter(Boolean);
      return of.length ? [0, 1, 2].map((i) => of.reduce((sum, p) => sum + p[i], 0) / of.length) : null;
    };
    const left = middle("left"), right = middle("right"), up = [0, 0, 0];
    if (!left || !right) return null;
    up[upIndex] = upSign;
    return unit(cross(up, minus(right, left)));
  }
  function chooseViewpoint(frame) {
    const pane = { x: 0, y: 0, width: canvas.clientWidth || 1200, height: canvas.clientHeight || 576 };
    const people = layers[0].points.map((points) => Array.from({ length: K }, (_, k) => at(points, frame, k)).filter(Boolean)).filter((points) => points.length);
    if (!people.length) return;
    const fronts = layers[0].points.map((points) => frontOf(points, frame)).filter(Boolean);
    let best = null;
    for (const tilt of [0.35, 0.2, 0.5, 0.65, 0.8]) for (let step = 0; step < 48; step++) {
      Object.assign(state, { turn: 0.9 + step * Math.PI / 24, tilt });
      fitView(state.wide);
      const cost = viewCost(people, fronts, pane);
      if (!best || cost < best.cost - 1e-9) best = { cost, turn: state.turn, tilt };
    }
    Object.assign(state, { turn: best.turn, tilt: best.tilt });
    fitView(state.wide);
  }
  const firstFrame = fullestFrame();
  if (!isPlanar) chooseViewpoint(firstFrame);
