  // Playback and navigation: play, scrub, keyboard shortcuts, pointer gestures.
  const box = element("scene"), scrub = element("scrub"), position = element("position"), play = element("play");
  const frameListeners = [], playListeners = [];
  let playing = false, last = 0, framesDue = 0, returnTarget = null, redrawPending = false;
  const redraw = () => { if (!redrawPending) { redrawPending = true; requestAnimationFrame(() => { redrawPending = false; draw(); }); } };
  scrub.max = String(Math.max(nFrames - 1, 0));
  for (const part of [play, scrub, position, element("speed").parentElement]) part.hidden = scene.volume && nFrames < 2;
  const secondsOf = (frame) => scene.time ? scene.time[frame] : frame / scene.rate;
  function show(next) {
    state.frame = Math.max(0, Math.min(nFrames - 1, next));
    scrub.value = String(state.frame);
    position.textContent = `frame ${scene.frames[state.frame]}${scene.volume ? "" : `, ${secondsOf(state.frame).toFixed(2)} s`}`;
    scrub.setAttribute("aria-valuetext", position.textContent);
    box.dataset.frame = String(scene.frames[state.frame]);
    redraw();
    frameListeners.forEach((listener) => listener(state.frame));
  }
  const showFrameIndex = (frameIndex) => show(Math.round(frameIndex / scene.stride));
  // Show a frame, mark a keypoint, select its camera view, and remember the element to return to.
  function jumpTo(frameIndex, marked, from) {
    if (playing) toggle();
    returnTarget = from || null;
    state.marked = marked && marked.keypoint !== undefined ? marked : null;
    if (marked && marked.view !== undefined && scene.cameras.length) choose("view", marked.view);
    showFrameIndex(frameIndex);
    if (state.camera >= 0 && marked && marked.person !== undefined) zoomToPerson(marked.person);
    updateCaption();
    if (frameIndex % scene.stride) element("caption").append(" Nearest frame in the scene.");
    element("scene-section").scrollIntoView({ block: "nearest" });
  }
  function updateCaption() {
    const m = state.marked;
    if (!m) { element("caption").textContent = ""; return; }
    const person = m.person !== undefined && several ? ` of ${scene.people[m.person]}` : "";
    const through = state.camera >= 0 ? `, view of ${scene.cameras[state.camera].name}` : "";
    element("caption").textContent = `Marked: ${scene.keypoints[m.keypoint]}${person}${through}. Press Esc to return.`;
  }
  function tick(now) {
    if (!playing) return;
    framesDue += ((now - last) / 1000) * scene.rate * Number(element("speed").value);
    last = now;
    const whole = Math.floor(framesDue);
    if (whole > 0) { framesDue -= whole; show((state.frame + whole) % nFrames); }
    requestAnimationFrame(tick);
  }
  function toggle() {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
    if (playing) { last = performance.now(); framesDue = 0; requestAnimationFrame(tick); }
    playListeners.forEach((listener) => listener());
  }
  play.addEventListener("click", toggle);
  scrub.addEventListener("input", () => show(Number(scrub.value)));
  addEventListener("resize", redraw);
  addEventListener("themechange", () => { readColors(); solids?.recolor(); draw(); });

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
  function cycleOption(id, by) {
    const menu = element(id);
    if (menu.parentElement.hidden) return;
    const n = menu.options.length;
    menu.selectedIndex = (menu.selectedIndex + by + n) % n;
    menu.dispatchEvent(new Event("change"));
  }
  fill("view", scene.cameras.map((camera) => camera.name), "free", (i) => { state.camera = i; state.zoom = { scale: 1, center: null }; updateCaption(); redraw(); });
  fill("layer", layers.map((layer) => layer.name), null, (i) => { state.layer = i; redraw(); });
  fill("follow", scene.people, "none", (i) => {
    state.follow = i;
    if (i >= 0 && state.camera >= 0) zoomToPerson(i);
    else if (i >= 0) state.distance = Math.min(state.distance, isPlanar ? state.distance : 2.4 * bodySize());
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
  function bindCheckbox(id, key, possible) {
    element(id).checked = state[key];
    element(id).parentElement.hidden = !possible;
    element(id).addEventListener("change", () => { state[key] = element(id).checked; redraw(); });
  }
  bindCheckbox("side-by-side", "sideBySide", layers.length > 1);
  bindCheckbox("show-uncertainty", "covariances", Boolean(scene.volume) || covariances.some((codes) => codes.some((code, i) => i % 7 === 0 && code)));
  bindCheckbox("show-trails", "trails", false);
  const showTrailSwitch = () => { element("show-trails").parentElement.hidden = !scene.up || nFrames < 2; };
  bindCheckbox("show-truth", "truth", Boolean(truth));
  element("truth-hint").hidden = !truth;
  element("camera-hint").hidden = !scene.cameras.length || !scene.markedViews;
  if (several && truth) element("truth-hint").lastElementChild.style.color = "var(--faint)";
  const fit = element("fit");
  fit.hidden = !scene.cameras.length;
  fit.addEventListener("click", () => {
    choose("view", -1);
    choose("follow", -1);
    fitView(!state.wide);
    nameFit();
    redraw();
  });
  const nameFit = () => { fit.textContent = state.wide ? `Show ${scene.filmed || "people"}` : "Show cameras"; };
  nameFit();
  const help = element("help"), keys = element("keys");
  keys.addEventListener("click", () => { help.hidden = !help.hidden; keys.setAttribute("aria-expanded", String(!help.hidden)); });

  const toggleCheckbox = (id) => { if (!element(id).parentElement.hidden) element(id).click(); };
  const changeSpeed = (by) => { const menu = element("speed"); menu.selectedIndex = Math.max(0, Math.min(menu.options.length - 1, menu.selectedIndex + by)); };
  const second = () => Math.max(1, Math.round(scene.rate));
  const zoom = (by) => {
    if (state.camera >= 0) state.zoom.scale = Math.max(0.5, Math.min(40, state.zoom.scale / by));
    else state.distance *= by;
    redraw();
  };
  const turn = (by, tilt) => {
    if (state.camera >= 0 || isPlanar) return;
    state.turn += by;
    state.tilt = Math.max(-1.5, Math.min(1.5, state.tilt + tilt));
    redraw();
  };
  const ACTIONS = {
    " ": toggle, "ArrowRight": (shift) => show(state.frame + (shift ? second() : 1)), "ArrowLeft": (shift) => show(state.frame - (shift ? second() : 1)),
    "Home": () => show(0), "End": () => show(nFrames - 1), "[": () => changeSpeed(-1), "]": () => changeSpeed(1),
    "c": (shift) => cycleOption("view", shift ? -1 : 1), "0": () => choose("view", -1), "f": () => cycleOption("follow", 1), "l": () => cycleOption("layer", 1),
    "b": () => toggleCheckbox("side-by-side"), "u": () => toggleCheckbox("show-uncertainty"), "t": () => toggleCheckbox("show-truth"), "?": () => keys.click(),
    "a": () => turn(-0.1, 0), "d": () => turn(0.1, 0), "w": () => turn(0, 0.1), "s": () => turn(0, -0.1), "+": () => zoom(0.9), "-": () => zoom(1 / 0.9),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape" && returnTarget) { returnTarget.focus(); returnTarget.scrollIntoView({ block: "center" }); returnTarget = null; return; }
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
    const link = event.target.closest("[data-frame-index]");
    if (!link) return;
    const { frameIndex, person, keypoint, view } = link.dataset, number = (text) => text === undefined ? undefined : Number(text);
    jumpTo(Number(frameIndex), { person: number(person), keypoint: number(keypoint), view: number(view) }, link);
  });

  // One finger or the left button rotates; two fingers zoom; drag with Shift pans.
  const pointers = new Map();
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); pointers.set(event.pointerId, event); });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) { showTooltip(event); return; }
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    if (pointers.size === 2) {
      const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      const apart = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY) || 1;
      zoom(apart(before) / apart(event));
    } else if (event.shiftKey || event.buttons === 4 || isPlanar || state.camera >= 0) move(dx, dy);
    else turn(-0.008 * dx, 0.008 * dy);
    pointers.set(event.pointerId, event);
  });
  function move(dx, dy) {
    if (state.follow >= 0) choose("follow", -1);
    if (state.camera >= 0) {
      const [x, y] = state.zoom.center || scene.cameras[state.camera].size.map((v) => v / 2);
      state.zoom.center = [x - dx / state.zoom.pixels, y - dy / state.zoom.pixels];
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
  const tooltip = element("tooltip");
  canvas.addEventListener("pointerleave", () => { tooltip.hidden = true; });
  function showTooltip(event) {
    const { left, top } = canvas.getBoundingClientRect(), x = event.clientX - left, y = event.clientY - top;
    const near = dots.reduce((best, dot) => { const d = Math.hypot(dot.x - x, dot.y - y); return d < best.d ? { d, dot } : best; }, { d: 12, dot: null }).dot;
    tooltip.hidden = !near;
    if (!near) return;
    const digits = size < 0.5 ? 4 : 3, how = ["", "", ", filled or held"][mark(near.person, state.frame, near.k, 0)] || "";
    tooltip.textContent = `${several ? `${scene.people[near.person]}: ` : ""}${scene.keypoints[near.k]}${how}\n${near.p.map((v) => v.toFixed(digits)).join(", ")} ${scene.unit}`;
    tooltip.style.left = `${Math.min(near.x + 12, canvas.clientWidth - 190)}px`;
    tooltip.style.top = `${Math.min(near.y + 12, canvas.clientHeight - 50)}px`;
  }
