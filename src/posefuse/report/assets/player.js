  // Time and the ways to look: play, scrub, keys, drags.
  const box = element("scene"), scrub = element("scrub"), where = element("where"), play = element("play");
  const onShow = [];
  let playing = false, last = 0, carry = 0, cameFrom = null, asked = false;
  const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); } };
  scrub.max = String(Math.max(nFrames - 1, 0));
  const secondsOf = (frame) => scene.time ? scene.time[frame] : frame / scene.rate;
  function show(next) {
    state.frame = Math.max(0, Math.min(nFrames - 1, next));
    scrub.value = String(state.frame);
    where.textContent = `frame ${scene.frames[state.frame]}, ${secondsOf(state.frame).toFixed(2)} s`;
    scrub.setAttribute("aria-valuetext", where.textContent);
    box.dataset.frame = String(scene.frames[state.frame]);
    redraw();
    onShow.forEach((told) => told(state.frame));
  }
  const showPlace = (place) => show(Math.round(place / scene.stride));
  // Show a frame for a reason: mark what it is about, look through its camera, and remember where the reader was.
  function jumpTo(place, marked, from) {
    if (playing) toggle();
    cameFrom = from || null;
    state.marked = marked && marked.keypoint !== undefined ? marked : null;
    if (marked && marked.view !== undefined && scene.cameras.length) choose("view", marked.view);
    showPlace(place);
    if (state.camera >= 0 && marked && marked.person !== undefined) zoomOn(marked.person);
    say();
    if (place % scene.stride) element("shown").append(" This is the nearest of the frames shown.");
    element("scene-section").scrollIntoView({ block: "nearest" });
  }
  function say() {
    const m = state.marked;
    if (!m) { element("shown").textContent = ""; return; }
    const who = m.person !== undefined && several ? ` of ${scene.people[m.person]}` : "";
    const through = state.camera >= 0 ? `, through ${scene.cameras[state.camera].name}` : "";
    element("shown").textContent = `Marked: ${scene.keypoints[m.keypoint]}${who}${through}. Esc leads back.`;
  }
  function tick(now) {
    if (!playing) return;
    carry += ((now - last) / 1000) * scene.rate * Number(element("speed").value);
    last = now;
    const whole = Math.floor(carry);
    if (whole > 0) { carry -= whole; show((state.frame + whole) % nFrames); }
    requestAnimationFrame(tick);
  }
  function toggle() {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
    if (playing) { last = performance.now(); carry = 0; requestAnimationFrame(tick); }
  }
  play.addEventListener("click", toggle);
  scrub.addEventListener("input", () => show(Number(scrub.value)));
  addEventListener("resize", redraw);
  dark.addEventListener("change", () => { readColours(); redraw(); });

  function fill(id, names, first, chosen) {
    const menu = element(id);
    [...(first ? [[first, -1]] : []), ...names.map((name, i) => [name, i])].forEach(([name, value]) => menu.append(new Option(name, value)));
    menu.addEventListener("change", () => chosen(Number(menu.value)));
    menu.parentElement.hidden = names.length < (first ? 1 : 2);
  }
  function choose(id, value) {
    element(id).value = String(value);
    element(id).dispatchEvent(new Event("change"));
  }
  function turnOver(id, by) {
    const menu = element(id);
    if (menu.parentElement.hidden) return;
    const n = menu.options.length;
    menu.selectedIndex = (menu.selectedIndex + by + n) % n;
    menu.dispatchEvent(new Event("change"));
  }
  fill("view", scene.cameras.map((camera) => camera.name), "free", (i) => { state.camera = i; state.zoom = { scale: 1, centre: null }; say(); redraw(); });
  fill("layer", layers.map((layer) => layer.name), null, (i) => { state.layer = i; redraw(); });
  fill("follow", scene.people, "nobody", (i) => {
    state.follow = i;
    if (i >= 0 && state.camera >= 0) zoomOn(i);
    else if (i >= 0) state.distance = Math.min(state.distance, flat ? state.distance : 2.4 * bodySize());
    redraw();
  });
  function bodySize() {
    const low = [1e9, 1e9, 1e9], high = low.map((v) => -v);
    for (let k = 0; k < K; k++) {
      const p = at(layers[state.layer].points[state.follow], state.frame, k);
      if (p) for (let i = 0; i < 3; i++) { low[i] = Math.min(low[i], p[i]); high[i] = Math.max(high[i], p[i]); }
    }
    return high[0] < low[0] ? state.distance : Math.hypot(...minus(high, low));
  }
  function tick_box(id, key, possible) {
    element(id).checked = state[key];
    element(id).parentElement.hidden = !possible;
    element(id).addEventListener("change", () => { state[key] = element(id).checked; redraw(); });
  }
  tick_box("beside", "beside", layers.length > 1);
  tick_box("show-spreads", "spreads", spreads.some((codes) => codes.some((code, i) => i % 7 === 0 && code)));
  tick_box("show-truth", "truth", Boolean(truth));
  element("truth-hint").hidden = !truth;
  element("camera-hint").hidden = !scene.cameras.length || !scene.markedViews;
  if (several && truth) element("truth-hint").lastElementChild.style.color = "var(--faint)";
  const fit = element("fit");
  fit.hidden = !scene.cameras.length;
  fit.addEventListener("click", () => {
    choose("view", -1);
    choose("follow", -1);
    fitView(!state.wide);
    fit.textContent = state.wide ? "Show people" : "Show cameras";
    redraw();
  });
  const help = element("help"), keys = element("keys");
  keys.addEventListener("click", () => { help.hidden = !help.hidden; keys.setAttribute("aria-expanded", String(!help.hidden)); });

  const flip = (id) => { if (!element(id).parentElement.hidden) element(id).click(); };
  const faster = (by) => { const menu = element("speed"); menu.selectedIndex = Math.max(0, Math.min(menu.options.length - 1, menu.selectedIndex + by)); };
  const second = () => Math.max(1, Math.round(scene.rate));
  const zoom = (by) => {
    if (state.camera >= 0) state.zoom.scale = Math.max(0.5, Math.min(40, state.zoom.scale / by));
    else state.distance *= by;
    redraw();
  };
  const turn = (by, tilt) => {
    if (state.camera >= 0 || flat) return;
    state.turn += by;
    state.tilt = Math.max(-1.5, Math.min(1.5, state.tilt + tilt));
    redraw();
  };
  const ACTIONS = {
    " ": toggle, "ArrowRight": (shift) => show(state.frame + (shift ? second() : 1)), "ArrowLeft": (shift) => show(state.frame - (shift ? second() : 1)),
    "Home": () => show(0), "End": () => show(nFrames - 1), "[": () => faster(-1), "]": () => faster(1),
    "c": (shift) => turnOver("view", shift ? -1 : 1), "0": () => choose("view", -1), "f": () => turnOver("follow", 1), "l": () => turnOver("layer", 1),
    "b": () => flip("beside"), "u": () => flip("show-spreads"), "t": () => flip("show-truth"), "?": () => keys.click(),
    "a": () => turn(-0.1, 0), "d": () => turn(0.1, 0), "w": () => turn(0, 0.1), "s": () => turn(0, -0.1), "+": () => zoom(0.9), "-": () => zoom(1 / 0.9),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape" && cameFrom) { cameFrom.focus(); cameFrom.scrollIntoView({ block: "center" }); cameFrom = null; return; }
    const target = event.target, arrows = event.key.startsWith("Arrow") || event.key === "Home" || event.key === "End";
    if (target.tagName === "SELECT" || target.closest("[role=grid]") || (target === scrub && arrows)) return;
    if (["BUTTON", "SUMMARY"].includes(target.tagName) && (event.key === " " || event.key === "Enter")) return;
    if (target.type === "checkbox" && event.key === " ") return;
    const action = ACTIONS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event.shiftKey);
  });
  document.addEventListener("click", (event) => {
    const link = event.target.closest("[data-place]");
    if (!link) return;
    const { place, person, keypoint, view } = link.dataset, number = (text) => text === undefined ? undefined : Number(text);
    jumpTo(Number(place), { person: number(person), keypoint: number(keypoint), view: number(view) }, link);
  });

  // One finger or the left button turns; two fingers or Shift move and zoom.
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, event); });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) { hover(event); return; }
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    if (fingers.size === 2) {
      const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
      const apart = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY) || 1;
      zoom(apart(before) / apart(event));
    } else if (event.shiftKey || event.buttons === 4 || flat || state.camera >= 0) move(dx, dy);
    else turn(-0.008 * dx, 0.008 * dy);
    fingers.set(event.pointerId, event);
  });
  function move(dx, dy) {
    if (state.follow >= 0) choose("follow", -1);
    if (state.camera >= 0) {
      const [x, y] = state.zoom.centre || scene.cameras[state.camera].size.map((v) => v / 2);
      state.zoom.centre = [x - dx / state.zoom.pixels, y - dy / state.zoom.pixels];
      redraw();
      return;
    }
    const { right, down } = axesOf(), scale = 2 * state.distance / (FOCAL * Math.min(canvas.clientWidth, 1.4 * canvas.clientHeight));
    state.target = state.target.map((v, i) => v - scale * (dx * right[i] + dy * down[i]));
    redraw();
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.0012 * event.deltaY));
  }, { passive: false });
  const tip = element("tip");
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  function hover(event) {
    const { left, top } = canvas.getBoundingClientRect(), x = event.clientX - left, y = event.clientY - top;
    const near = dots.reduce((best, dot) => { const d = Math.hypot(dot.x - x, dot.y - y); return d < best.d ? { d, dot } : best; }, { d: 12, dot: null }).dot;
    tip.hidden = !near;
    if (!near) return;
    const digits = size < 0.5 ? 4 : 3, how = ["", "", ", filled or held"][mark(near.person, state.frame, near.k, 0)] || "";
    tip.textContent = `${several ? `${scene.people[near.person]}: ` : ""}${scene.keypoints[near.k]}${how}\n${near.p.map((v) => v.toFixed(digits)).join(", ")} ${scene.unit}`;
    tip.style.left = `${Math.min(near.x + 12, canvas.clientWidth - 190)}px`;
    tip.style.top = `${Math.min(near.y + 12, canvas.clientHeight - 50)}px`;
  }
