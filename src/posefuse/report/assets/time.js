  later(() => runLibrary("plotly"));

  // Charts over time: lines, gaps, bones. A cursor in each chart marks the displayed frame; a click shows a frame.
  const font = { color: css("--ink"), family: "system-ui, sans-serif", size: 0.75 * parseFloat(getComputedStyle(document.documentElement).fontSize) };
  const base = { margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, font, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)" };
  const config = { displaylogo: false, responsive: true, displayModeBar: false };
  const grid = { gridcolor: css("--line"), zeroline: false };
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;");
  const colorOf = (i) => css(`--person-${i % 10}`);
  const dashOf = (i) => ["solid", "dash", "dot", "dashdot"][Math.floor(i / 1) % 4];
  const timeOf = (frame) => series.unit === "s" ? secondsOf(frame) : scene.frames[frame];
  const first = series.time[0], end = series.time[series.time.length - 1];
  const timeAxis = { ...grid, title: { text: series.unit }, range: [first, end > first ? end : first + 1] };
  function frameIndexAt(time) {
    let best = 0;
    series.time.forEach((t, i) => { if (Math.abs(t - time) < Math.abs(series.time[best] - time)) best = i; });
    return series.frameIndex[best];
  }
  function cursor(plot) {
    const line = Object.assign(document.createElement("div"), { className: "cursor" });
    plot.append(line);
    const place = () => {
      const full = plot._fullLayout;
      if (!full || !full.xaxis || !full.xaxis.l2p) return;
      const x = full.xaxis.l2p(timeOf(state.frame)), inside = x >= 0 && x <= full.xaxis._length;
      Object.assign(line.style, { left: `${full.xaxis._offset + x}px`, top: `${full.yaxis._offset}px`, height: `${full.yaxis._length}px`, display: inside ? "block" : "none" });
    };
    frameListeners.push(place);
    plot.on("plotly_afterplot", place);
    plot.on("plotly_click", ({ points }) => {
      const of = points[0], isGap = plot.closest("#gaps");
      jumpTo(frameIndexAt(of.x), isGap ? { keypoint: scene.keypoints.indexOf(of.customdata), person: gapPerson } : null, plot);
    });
    plot.tabIndex = -1;
    place();
  }
  function lines(id, values, title, range) {
    const drawn = values.map((y, i) => ({ type: "scatter", mode: "lines", name: scene.people[i], x: series.time, y,
      line: { color: several ? colorOf(i) : css("--left"), width: 1.5, dash: dashOf(i) }, hovertemplate: `%{y:.2f} at %{x:.2f}<extra>${plain(scene.people[i])}</extra>` }));
    Plotly.newPlot(id, drawn, { ...base, margin: { l: 60, r: 10, t: 24, b: 40 }, showlegend: several, legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 },
      hovermode: "closest", xaxis: timeAxis, yaxis: { ...grid, title: { text: title }, ...range } }, config);
    cursor(element(id));
  }
  later(() => lines("time-error", series.error, "reprojection error, px", { rangemode: "tozero" }));
  later(() => lines("time-views", series.views, "views used", { range: [0, charts.views.length + 0.3] }));

  // The selected bone and its counterpart on the other side, if there is one.
  const counterpart = (name) => name.includes("left") ? name.replaceAll("left", "right") : name.includes("right") ? name.replaceAll("right", "left") : null;
  function drawBone(b) {
    const other = counterpart(series.bones[b]) ? series.bones.indexOf(counterpart(series.bones[b])) : -1;
    const chosen = [b, other].filter((i) => i >= 0), drawn = [];
    series.lengths.forEach((bones, p) => chosen.forEach((i, n) => drawn.push({ type: "scatter", mode: "lines", x: series.time, y: bones[i],
      name: `${several ? `${scene.people[p]}: ` : ""}${series.bones[i]}`, hovertemplate: `%{y:.1f} ${series.boneUnit} at %{x:.2f}<extra></extra>`,
      line: { width: 1.5, dash: n ? "dot" : "solid", color: several ? colorOf(p) : css(n ? "--right" : "--left") } })));
    const made = Boolean(element("bones").data);
    Plotly.react("bones", drawn, { ...base, margin: { l: 60, r: 10, t: 40, b: 40 }, showlegend: true, hovermode: "closest",
      legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 }, xaxis: timeAxis, yaxis: { ...grid, title: { text: series.boneUnit } } }, config);
    element("bone-name").textContent = `${series.bones[b]}${other >= 0 ? ` (dotted: other side)` : ""}`;
    if (!made) cursor(element("bones"));
  }
  if (element("bones")) {
    const median = (values) => { const known = values.filter((v) => v !== null).sort((a, b) => a - b); return known.length ? known[known.length >> 1] : 0; };
    const lengths = series.bones.map((_, b) => Math.max(...series.lengths.map((bones) => median(bones[b]))));
    later(() => drawBone(lengths.indexOf(Math.max(...lengths))));
    document.addEventListener("click", (event) => { if (event.target.matches(".bone")) { drawBone(Number(event.target.dataset.bone)); element("bones").scrollIntoView({ block: "nearest" }); } });
  }
