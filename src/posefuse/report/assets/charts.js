  // Bar charts and the chart of track states.
  const chart = { ...base, margin: { l: 60, r: 10, t: 60, b: 40 }, showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 } };
  const bars = (names, values, name, color) => ({ type: "bar", x: names, y: values, name, marker: { color: color } });
  later(() => Plotly.newPlot("view-errors", [bars(charts.views, charts.view_median, "median", css("--left")),
    bars(charts.views, charts.view_p90, "90th percentile", css("--middle"))],
  { ...chart, yaxis: { ...grid, title: { text: "reprojection error, px" } }, barmode: "group" }, config));
  const shareColors = { "used": css("--left"), "used swapped": css("--swapped"), "outlier": css("--right"), "low confidence": "#cc79a7", "unseen": css("--line"), "other": css("--middle") };
  later(() => Plotly.newPlot("view-shares", Object.entries(charts.view_shares).map(([name, values]) =>
    bars(charts.views, values, name, shareColors[name])),
  { ...chart, yaxis: { ...grid, tickformat: ".0%", range: [0, 1] }, barmode: "stack" }, config));
  if (swaps) {
    element("swaps").style.height = `${90 + 16 * swaps.rows.length}px`;
    later(() => Plotly.newPlot("swaps", [{ type: "heatmap", x: swaps.time, y: swaps.rows, z: swaps.share, zmin: 0, zmax: 1, ygap: 1,
      colorscale: [[0, css("--line")], [1, css("--right")]], hoverongaps: false,
      hovertemplate: "%{y}, %{x:.2f}: %{z:.0%} swapped<extra></extra>",
      colorbar: { title: { text: "swapped" }, tickformat: ".0%", thickness: 10 } }],
    { ...base, margin: { l: 140, r: 10, t: 10, b: 40 }, xaxis: { ...grid, title: { text: swaps.unit } },
      yaxis: { autorange: "reversed", automargin: true } }, config));
  }
  if (tracks && tracks.rows.length && tracks.people) later(drawTrackStates);
  function drawTrackStates() {
    const times = tracks.time, drawn = [];
    const styles = { active: { width: 10 }, tentative: { width: 3 }, lost: { width: 3, dash: "2px,3px" } };
    tracks.runs.forEach((runs, p) => {
      for (const [state, style] of Object.entries(styles)) {
        const x = [], y = [];
        for (const [of, from, to] of runs) if (of === state) { x.push(times[from], times[to], null); y.push(p, p, null); }
        if (x.length) drawn.push({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip", showlegend: false,
          line: { color: colorOf(p), ...style } });
      }
    });
    const symbols = { "confirmed": "triangle-up", "lost": "triangle-down-open", "reacquired": "diamond", "reidentified": "diamond",
      "terminated": "x-thin-open", "possible_identity_switch": "star", "identities_swapped": "star-diamond",
      "limb_reinitialized": "circle-open", "lengths_reestimated": "cross-open", "camera_rejected": "square", "camera_restored": "square-open",
      "camera_silent": "hexagon2", "camera_back": "hexagon2-open" };
    const kinds = Object.keys(symbols).filter((kind) => tracks.events.some((event) => event[2] === kind));
    for (const kind of kinds) {
      const of = tracks.events.filter((event) => event[2] === kind);
      drawn.push({ type: "scatter", mode: "markers", name: kind, showlegend: true, cliponaxis: false, x: of.map((event) => times[event[0]]),
        y: of.map((event) => event[1] - 0.32), customdata: of.map((event) => event[0]), hoverinfo: "text",
        hovertext: of.map(([, row, what, why, number]) => plain(`${tracks.rows[row]}, frame ${number}: ${what}${why ? ": " + why : ""}`)
          .replace(/(.{50,70}?) /g, "$1<br>")),
        marker: { symbol: symbols[kind], size: 9, color: css("--ink"), line: { width: 1.5, color: css("--ink") } } });
    }
    const plot = element("track-states"), n = tracks.rows.length;
    plot.style.height = `${80 + (n > 20 ? 18 : 30) * n}px`;
    Plotly.newPlot(plot, drawn, { ...base, margin: { l: 120, r: 10, t: 30, b: 40 }, hovermode: "closest",
      showlegend: kinds.length > 0, legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 },
      xaxis: { ...grid, title: { text: tracks.unit }, range: [times[0], times[times.length - 1]] },
      yaxis: { ...grid, range: [n - 0.5, -0.75], tickvals: tracks.rows.map((_, i) => i),
        ticktext: tracks.rows.map(plain),
        ticks: "outside", ticklen: 8, tickcolor: "rgba(0,0,0,0)", automargin: true } }, config);
    plot.on("plotly_click", ({ points }) => {
      if (points[0].customdata !== undefined) jumpTo(points[0].customdata, null, plot);
    });
  }
  // One chart per body part.
  const horizontalBars = (names, values, name, color) => ({ type: "bar", orientation: "h", y: names, x: values, name, marker: { color: color } });
  function drawKeypoints(plot, indices) {
    const of = (values) => indices.map((k) => values[k]);
    plot.style.height = `${120 + (indices.length > 40 ? 13 : 18) * indices.length}px`;
    Plotly.newPlot(plot, [horizontalBars(of(charts.keypoints), of(charts.keypoint_median), "median", css("--left")),
      horizontalBars(of(charts.keypoints), of(charts.keypoint_p90), "90th percentile", css("--middle"))],
    { ...chart, margin: { l: 60, r: 10, t: 40, b: 40 }, legend: { orientation: "h", y: 1.0, yanchor: "bottom", x: 0 }, barmode: "group",
      xaxis: { ...grid, title: { text: "reprojection error, px" } },
      yaxis: { autorange: "reversed", automargin: true, tickfont: { size: indices.length > 40 ? 10 : 12 }, dtick: 1 } }, config);
  }
  parts.forEach((part, i) => {
    const plot = document.createElement("div");
    if (!folded) {
      element("keypoint-errors").append(plot);
      later(() => drawKeypoints(plot, part.keypoints));
      return;
    }
    const medians = part.keypoints.map((k) => charts.keypoint_median[k]).filter((v) => v !== null).sort((x, y) => x - y);
    const median = medians.length ? `, median of medians ${medians[medians.length >> 1].toFixed(1)} px` : "";
    element("keypoint-errors").append(foldPart(partTitle(part) + median, plot, i === 0, () => drawKeypoints(plot, part.keypoints)));
  });

  // Printed pages show the table of keypoints even if it is collapsed on the screen.
  addEventListener("topaper", () => document.querySelectorAll("details.printed").forEach((fold) => { fold.open = true; }));
  if (nFrames) show(firstFrame);
