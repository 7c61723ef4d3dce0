"use strict";
(() => {
  const { scene, charts, swaps, lives } = JSON.parse(document.getElementById("data").textContent);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const unpack = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  };
  const K = scene.keypoints.length;
  const people = scene.people.map((person) => ({ name: person.name, points: unpack(person.points) }));
  const truth = scene.truth ? scene.truth.map(unpack) : null;
  const nFrames = scene.frames.length;
  const element = (id) => document.getElementById(id);
  const colours = { left: css("--left"), right: css("--right"), middle: css("--middle") };
  const several = people.length !== 1;
  const colourOf = (i) => css(`--person-${i % 10}`);
  const font = { color: css("--ink"), family: "system-ui, sans-serif" };

  // Bones of one frame as a broken line: three coordinates and a gap for each edge.
  function bones(points, frame, side) {
    const x = [], y = [], z = [];
    for (const [a, b] of scene.edges) {
      const of = [scene.sides[a], scene.sides[b]];
      const edgeSide = of[0] === of[1] ? of[0] : of.includes("left") && !of.includes("right") ? "left"
        : of.includes("right") && !of.includes("left") ? "right" : "middle";
      if (side && edgeSide !== side) continue;
      for (const k of [a, b]) {
        const at = (frame * K + k) * 3;
        x.push(points[at]); y.push(points[at + 1]); z.push(points[at + 2]);
      }
      x.push(null); y.push(null); z.push(null);
    }
    return [x, y, z];
  }

  function dots(points, frame) {
    const x = [], y = [], z = [];
    for (let k = 0; k < K; k++) {
      const at = (frame * K + k) * 3;
      x.push(points[at]); y.push(points[at + 1]); z.push(points[at + 2]);
    }
    return [x, y, z];
  }

  const line = (colour, width) => ({ type: "scatter3d", mode: "lines", hoverinfo: "skip", line: { color: colour, width } });
  const traces = [];
  const moving = [];
  // A trace that begins with no point at all is drawn in the wrong size ever after: begin where there is one.
  const firstFrame = (points) => Math.max(Math.floor(points.findIndex(Number.isFinite) / (3 * K)), 0);
  const firstSeen = people.map(({ points }) => points).filter((points) => points.some(Number.isFinite)).map(firstFrame);
  const opening = firstSeen.length ? Math.min(...firstSeen) : 0;
  function add(trace, draw, first = opening) {
    if (draw) { moving.push({ index: traces.length, draw }); [trace.x, trace.y, trace.z] = draw(first); }
    traces.push(trace);
  }
  // Names stand a hand's breadth above the highest point of each body.
  function heads(frameOf) {
    const at = [[], [], []], axis = Math.max("xyz".indexOf(scene.up.replace("-", "")), 0), sense = scene.up.startsWith("-") ? -1 : 1;
    for (const { points } of people) {
      const f = frameOf(points);
      let best = -1;
      for (let k = 0; k < K; k++) {
        const value = points[(f * K + k) * 3 + axis];
        if (Number.isFinite(value) && (best < 0 || sense * (value - points[best + axis]) > 0)) best = (f * K + k) * 3;
      }
      for (let i = 0; i < 3; i++) at[i].push(best < 0 ? null : points[best + i] + (i === axis ? 0.15 * sense : 0));
    }
    return at;
  }
  for (const points of truth || []) add({ ...line(css(several ? "--faint" : "--truth"), several ? 3 : 4), name: "truth" }, (f) => bones(points, f));
  if (several) element("truth-hint").lastElementChild.style.color = css("--faint");
  const truthTraces = (truth || []).map((_, i) => i);
  people.forEach(({ name, points }, i) => {
    if (!several) return;
    add({ ...line(colourOf(i), 6), name }, (f) => bones(points, f), firstFrame(points));
    add({ type: "scatter3d", mode: "markers", name, text: scene.keypoints.map((k) => `${name}: ${k}`), hoverinfo: "text+x+y+z",
      marker: { size: K > 60 ? 1.5 : 2.5, color: colourOf(i) } }, (f) => dots(points, f), firstFrame(points));
  });
  if (several && people.length) add({ type: "scatter3d", mode: "text", text: people.map(({ name }) => name), hoverinfo: "skip",
    textfont: { color: people.map((_, i) => colourOf(i)), size: 13 } }, (f) => heads(f === null ? firstFrame : () => f), null);
  for (const { name, points } of several ? [] : people) {
    for (const side of ["left", "right", "middle"]) add({ ...line(colours[side], 6), name }, (f) => bones(points, f, side));
    add({ type: "scatter3d", mode: "markers", name, text: scene.keypoints, hoverinfo: "text+x+y+z",
      marker: { size: K > 60 ? 1.5 : 3, color: scene.sides.map((s) => colours[s]) } }, (f) => dots(points, f));
  }
  for (const camera of scene.cameras) {
    const c = camera.centre, q = camera.corners;
    const path = [c, q[0], q[1], c, q[1], q[2], c, q[2], q[3], c, q[3], q[0]];
    add({ ...line(css("--faint"), 2), x: path.map((p) => p[0]), y: path.map((p) => p[1]), z: path.map((p) => p[2]) });
  }
  if (scene.cameras.length) {
    const of = (i) => scene.cameras.map((camera) => camera.centre[i]);
    add({ type: "scatter3d", mode: "text", x: of(0), y: of(1), z: of(2), hoverinfo: "skip",
      text: scene.cameras.map((camera) => camera.name), textfont: { color: css("--ink"), size: 12 } });
  }

  // Axis ranges: people by default (points farther out than their bulk reaches are strays), everything on request.
  function range(values, low, high) {
    const sorted = Float64Array.from(values.filter(Number.isFinite)).sort();
    if (!sorted.length) return [-1, 1];
    const bulk = [sorted[Math.floor(low * (sorted.length - 1))], sorted[Math.ceil(high * (sorted.length - 1))]];
    const reach = 0.3 * (bulk[1] - bulk[0]);
    return [Math.max(sorted[0], bulk[0] - reach), Math.min(sorted[sorted.length - 1], bulk[1] + reach)];
  }
  const all = [[], [], []];
  for (const { points } of people) for (let i = 0; i < points.length; i++) all[i % 3].push(points[i]);
  const peopleRanges = all.map((values) => range(values, 0.005, 0.995));
  const up = scene.up.replace("-", "");
  const upIndex = "xyz".indexOf(up);
  if (upIndex >= 0 && scene.unit === "m") {
    const floor = peopleRanges[upIndex];
    if (!scene.up.startsWith("-")) floor[0] = Math.min(floor[0], 0);
  }
  const allRanges = peopleRanges.map((r, i) => scene.cameras.reduce(
    ([low, high], camera) => [Math.min(low, camera.centre[i]), Math.max(high, camera.centre[i])], r));
  function layoutOf(ranges) {
    const margin = 0.06 * Math.max(...ranges.map(([a, b]) => b - a));
    const axis = (i) => ({ range: [ranges[i][0] - margin, ranges[i][1] + margin], title: { text: "xyz"[i] },
      gridcolor: css("--line"), color: css("--faint"), zeroline: false, showspikes: false });
    const spans = ranges.map(([a, b]) => b - a + 2 * margin);
    const most = Math.max(...spans);
    return { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual",
      aspectratio: { x: spans[0] / most, y: spans[1] / most, z: spans[2] / most } };
  }
  // Where the people are within the drawn ranges, in Plotly's own units (half the longest side is 0.5).
  function centreOf(ranges) {
    const most = Math.max(...ranges.map(([a, b]) => b - a)) * 1.12;
    const middle = ([a, b]) => (a + b) / 2;
    const at = ranges.map((r, i) => (middle(peopleRanges[i]) - middle(r)) / most);
    return { x: at[0], y: at[1], z: at[2] };
  }
  const sign = scene.up.startsWith("-") ? -1 : 1;
  const upVector = { x: 0, y: 0, z: 0 };
  upVector[upIndex >= 0 ? up : "z"] = sign;
  // A wide scene is looked at from nearer, so that people stay large enough to see.
  function eyeOf(distance) {
    const eye = { x: distance, y: 0.6 * distance, z: distance };
    eye[upIndex >= 0 ? up : "z"] = 0.4 * distance * sign;
    return eye;
  }
  const base = { margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, font,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)" };
  const config = { displaylogo: false, responsive: true, displayModeBar: false };
  const plot = element("scene");
  let fitted = scene.cameras.length ? "cameras" : "people";
  const viewOf = () => fitted === "people" ? [peopleRanges, 1.15] : [allRanges, 0.62];
  {
    const [ranges, distance] = viewOf();
    const camera = { up: upVector, eye: eyeOf(distance), center: centreOf(ranges) };
    Plotly.newPlot(plot, traces, { ...base, scene: { ...layoutOf(ranges), camera } }, config);
  }

  let frame = 0, playing = false, last = 0, carry = 0;
  const scrub = element("scrub"), where = element("where"), play = element("play");
  scrub.max = String(Math.max(nFrames - 1, 0));
  function show(next) {
    frame = Math.max(0, Math.min(nFrames - 1, next));
    const xyz = moving.map(({ draw }) => draw(frame));
    Plotly.restyle(plot, { x: xyz.map((p) => p[0]), y: xyz.map((p) => p[1]), z: xyz.map((p) => p[2]) },
      moving.map(({ index }) => index));
    scrub.value = String(frame);
    where.textContent = `frame ${scene.frames[frame]}, ${(frame / scene.rate).toFixed(2)} s`;
    plot.dataset.frame = String(frame);
  }
  function tick(now) {
    if (!playing) return;
    carry += ((now - last) / 1000) * scene.rate * Number(element("speed").value);
    last = now;
    const steps = Math.floor(carry);
    if (steps > 0) { carry -= steps; show((frame + steps) % nFrames); }
    requestAnimationFrame(tick);
  }
  function toggle() {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
    if (playing) { last = performance.now(); carry = 0; requestAnimationFrame(tick); }
  }
  play.addEventListener("click", toggle);
  scrub.addEventListener("input", () => show(Number(scrub.value)));
  document.addEventListener("keydown", (event) => {
    if (["INPUT", "SELECT", "BUTTON"].includes(event.target.tagName) && event.key !== "Escape") return;
    if (event.key === " ") { event.preventDefault(); toggle(); }
    if (event.key === "ArrowRight") show(frame + 1);
    if (event.key === "ArrowLeft") show(frame - 1);
  });
  const showTruth = element("show-truth");
  if (!truth) {
    showTruth.parentElement.hidden = true;
    element("truth-hint").hidden = true;
  }
  showTruth.addEventListener("change", () => Plotly.restyle(plot, { visible: showTruth.checked }, truthTraces));
  const fit = element("fit");
  if (!scene.cameras.length) fit.hidden = true;
  fit.addEventListener("click", () => {
    fitted = fitted === "people" ? "cameras" : "people";
    fit.textContent = fitted === "people" ? "Show cameras" : "Show people";
    const [ranges, distance] = viewOf();
    const { xaxis, yaxis, zaxis, aspectratio } = layoutOf(ranges);
    Plotly.relayout(plot, { "scene.xaxis": xaxis, "scene.yaxis": yaxis, "scene.zaxis": zaxis,
      "scene.aspectratio": aspectratio, "scene.camera.eye": eyeOf(distance), "scene.camera.center": centreOf(ranges) });
  });
  show(opening);

  const chart = { ...base, margin: { l: 60, r: 10, t: 10, b: 40 }, showlegend: true, legend: { orientation: "h", y: 1.15 } };
  const grid = { gridcolor: css("--line"), zeroline: false };
  const bars = (names, values, name, colour) => ({ type: "bar", x: names, y: values, name, marker: { color: colour } });
  Plotly.newPlot("view-errors", [bars(charts.views, charts.view_median, "median", css("--left")),
    bars(charts.views, charts.view_p90, "90 %", css("--middle"))],
  { ...chart, yaxis: { ...grid, title: { text: "px" } }, barmode: "group" }, config);
  const shareColours = { "used": css("--left"), "used swapped": css("--swapped"), "outlier": css("--right"), "low confidence": "#cc79a7", "unseen": css("--line"), "other": css("--middle") };
  Plotly.newPlot("view-shares", Object.entries(charts.view_shares).map(([name, values]) =>
    bars(charts.views, values, name, shareColours[name])),
  { ...chart, yaxis: { ...grid, tickformat: ".0%", range: [0, 1] }, barmode: "stack" }, config);
  if (swaps) {
    element("swaps").style.height = `${90 + 16 * swaps.rows.length}px`;
    Plotly.newPlot("swaps", [{ type: "heatmap", x: swaps.time, y: swaps.rows, z: swaps.share, zmin: 0, zmax: 1, ygap: 1,
      colorscale: [[0, css("--line")], [1, css("--right")]], hoverongaps: false,
      hovertemplate: "%{y}, %{x:.2f}: %{z:.0%} swapped<extra></extra>",
      colorbar: { title: { text: "swapped" }, tickformat: ".0%", thickness: 10 } }],
    { ...base, margin: { l: 140, r: 10, t: 10, b: 40 }, xaxis: { ...grid, title: { text: swaps.unit } },
      yaxis: { autorange: "reversed", automargin: true } }, config);
  }
  if (lives && lives.rows.length && lives.people) drawLives();
  function drawLives() {
    const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;");
    const times = lives.time, drawn = [];
    const styles = { active: { width: 10 }, tentative: { width: 3 }, lost: { width: 3, dash: "2px,3px" } };
    lives.runs.forEach((runs, p) => {
      for (const [state, style] of Object.entries(styles)) {
        const x = [], y = [];
        for (const [of, from, to] of runs) if (of === state) { x.push(times[from], times[to], null); y.push(p, p, null); }
        if (x.length) drawn.push({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip", showlegend: false,
          line: { color: colourOf(p), ...style } });
      }
    });
    const symbols = { "born": "triangle-up", "lost": "triangle-down-open", "found": "diamond", "returned": "diamond",
      "forgotten": "x-thin-open", "identity uncertain": "star", "identities exchanged": "star-diamond",
      "limb set anew": "circle-open", "camera refused": "square", "camera trusted": "square-open",
      "camera silent": "hexagon2", "camera heard again": "hexagon2-open" };
    const kinds = Object.keys(symbols).filter((kind) => lives.events.some((event) => event[2] === kind));
    for (const kind of kinds) {
      const of = lives.events.filter((event) => event[2] === kind);
      drawn.push({ type: "scatter", mode: "markers", name: kind, showlegend: true, cliponaxis: false, x: of.map((event) => times[event[0]]),
        y: of.map((event) => event[1] - 0.32), customdata: of.map((event) => event[0]), hoverinfo: "text",
        hovertext: of.map(([, row, what, why, number]) => plain(`${lives.rows[row]}, frame ${number}: ${what}${why ? ": " + why : ""}`)
          .replace(/(.{50,70}?) /g, "$1<br>")),
        marker: { symbol: symbols[kind], size: 9, color: css("--ink"), line: { width: 1.5, color: css("--ink") } } });
    }
    const plot = element("lives"), n = lives.rows.length;
    plot.style.height = `${80 + (n > 20 ? 18 : 30) * n}px`;
    Plotly.newPlot(plot, drawn, { ...base, margin: { l: 120, r: 10, t: 30, b: 40 }, hovermode: "closest",
      showlegend: kinds.length > 0, legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 },
      xaxis: { ...grid, title: { text: lives.unit }, range: [times[0], times[times.length - 1]] },
      yaxis: { ...grid, range: [n - 0.5, -0.75], tickvals: lives.rows.map((_, i) => i),
        ticktext: lives.rows.map(plain),
        ticks: "outside", ticklen: 8, tickcolor: "rgba(0,0,0,0)", automargin: true } }, config);
    plot.on("plotly_click", ({ points }) => {
      if (points[0].customdata !== undefined) show(Math.round(points[0].customdata / scene.stride));
    });
  }
  // A chart for each group of keypoints; hands and faces are folded until they are asked for.
  const across = (names, values, name, colour) => ({ type: "bar", orientation: "h", y: names, x: values, name, marker: { color: colour } });
  function drawKeypoints(plot, places) {
    const of = (values) => places.map((k) => values[k]);
    plot.style.height = `${120 + (places.length > 40 ? 13 : 18) * places.length}px`;
    Plotly.newPlot(plot, [across(of(charts.keypoints), of(charts.keypoint_median), "median px", css("--left")),
      across(of(charts.keypoints), of(charts.keypoint_p90), "90 % px", css("--middle"))],
    { ...chart, margin: { l: 60, r: 10, t: 40, b: 40 }, legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 }, barmode: "group",
      xaxis: { ...grid, title: { text: "px" } },
      yaxis: { autorange: "reversed", automargin: true, tickfont: { size: places.length > 40 ? 10 : 12 }, dtick: 1 } }, config);
  }
  charts.keypoint_groups.forEach(([name, places], i) => {
    const plot = document.createElement("div");
    if (charts.keypoint_groups.length === 1) {
      element("keypoint-errors").append(plot);
      drawKeypoints(plot, places);
      return;
    }
    const fold = document.createElement("details"), title = document.createElement("summary");
    const worst = places.map((k) => charts.keypoint_median[k]).filter((v) => v !== null).sort((x, y) => x - y);
    const middle = worst.length ? `, median of medians ${worst[worst.length >> 1].toFixed(1)} px` : "";
    title.textContent = `${name}: ${places.length} keypoints${middle}`;
    fold.append(title, plot);
    element("keypoint-errors").append(fold);
    fold.addEventListener("toggle", () => { if (fold.open && !plot.firstChild) drawKeypoints(plot, places); });
    fold.open = i === 0;
  });
})();
