  // Joint angles and gait cycles as small charts with left and right overlaid, and bars of foot contact.
  const sides = ["both", "left", "right"];
  const sideColor = { left: "--left", right: "--right", both: "--ink" };
  const pale = (color) => { const at = parseInt(color.slice(1), 16); return `rgba(${at >> 16}, ${(at >> 8) & 255}, ${at & 255}, 0.2)`; };
  const withGaps = (values) => values.map((v) => v === null ? NaN : v);
  function band(x, { mean, sd }, color) {
    // One polygon for each run of frames with values.
    const xs = [], ys = [];
    for (let i = 0; i < x.length; i += 1) {
      if (mean[i] === null || sd[i] === null) continue;
      let end = i;
      while (end < x.length && mean[end] !== null && sd[end] !== null) end += 1;
      const run = Array.from({ length: end - i }, (_, k) => i + k);
      xs.push(...run.map((k) => x[k]), ...run.map((k) => x[k]).reverse(), null);
      ys.push(...run.map((k) => mean[k] + sd[k]), ...run.map((k) => mean[k] - sd[k]).reverse(), null);
      i = end;
    }
    return { type: "scatter", mode: "lines", fill: "toself", x: xs, y: ys, line: { width: 0 }, fillcolor: pale(color), hoverinfo: "skip" };
  }
  function curves(x, of, unit) {
    return sides.filter((side) => of[side]).flatMap((side) => {
      const color = css(sideColor[side]);
      return [band(x, of[side], color), { type: "scatter", mode: "lines", x, y: withGaps(of[side].mean), line: { color, width: 1.6 },
        hovertemplate: `${side === "both" ? "" : `${side} `}%{y:.4~g} at %{x:.4~g} ${unit}<extra></extra>` }];
    });
  }
  function smallChart(parent, title, drawn, xaxis, shapes) {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption"), plot = document.createElement("div");
    caption.textContent = title;
    figure.append(caption, plot);
    parent.append(figure);
    plot.className = "multiple";
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", title);
    Plotly.newPlot(plot, drawn, { ...base, margin: { l: 40, r: 8, t: 6, b: 30 }, hovermode: "closest", shapes,
      xaxis, yaxis: { ...grid, nticks: 5, automargin: true } }, config);
    return plot;
  }
  // One chart at a time, so that the page stays responsive; charts of a person who is no longer selected are left out.
  const latest = new Map();
  function drawEach(parent, charts, drawOne) {
    const own = {};
    latest.set(parent, own);
    parent.replaceChildren();
    charts.forEach((chart) => later(() => { if (latest.get(parent) === own) drawOne(chart); }));
  }
  function peopleMenu(place, names, choose) {
    if (names.length > 1) {
      const menu = document.createElement("select");
      menu.setAttribute("aria-label", "Subject");
      names.forEach((name, i) => menu.append(new Option(name, i)));
      menu.addEventListener("change", () => choose(Number(menu.value)));
      element(place).append(menu);
    }
    later(() => choose(0));
  }
  if (element("cycles")) peopleMenu("cycle-people", movement.cycles.map(({ person }) => person), (p) => {
    const { panels, stance, numbers } = movement.cycles[p], percent = Array.from({ length: 101 }, (_, i) => i);
    const shapes = stance.map((x, s) => ({ x, s })).filter(({ x }) => x !== null).map(({ x, s }) => ({ type: "line", xref: "x", yref: "paper", x0: x, x1: x,
      y0: 0, y1: 1, line: { width: 1, dash: "dot", color: css(s ? "--right" : "--left") } }));
    element("cycle-numbers").textContent = numbers;
    drawEach(element("cycles"), panels, (panel) =>
      smallChart(element("cycles"), panel.title, curves(percent, panel, "%"), { ...grid, range: [0, 100], ticksuffix: " %", tickvals: [0, 25, 50, 75, 100] }, shapes));
  });
  if (element("angles")) peopleMenu("angle-people", scene.people, (p) => {
    const own = movement.angles.map((angle) => sides.reduce((of, side) =>
      angle[side] ? { ...of, [side]: { mean: angle[side].mean[p], sd: angle[side].sd[p] } } : of, { title: angle.title }));
    const known = own.filter((angle) => sides.some((side) => angle[side]?.mean.some((v) => v !== null)));
    drawEach(element("angles"), known, (angle) =>
      cursor(smallChart(element("angles"), angle.title, curves(series.time, angle, series.unit), { ...timeAxis, title: undefined, nticks: 5, ticksuffix: ` ${series.unit}` }, [])));
  });
  if (element("contact")) {
    const rows = movement.contact, plot = element("contact");
    const drawn = rows.flatMap(({ side, spans }, row) => spans.length ? [{ type: "scatter", mode: "lines", hoverinfo: "x",
      x: spans.flatMap(([from, to]) => [from, to, null]), y: spans.flatMap(() => [row, row, null]), line: { width: 10, color: css(sideColor[side]) } }] : []);
    plot.style.height = `${50 + 20 * rows.length}px`;
    later(() => {
      Plotly.newPlot(plot, drawn, { ...base, margin: { l: 120, r: 10, t: 6, b: 40 }, hovermode: "closest", xaxis: timeAxis,
      yaxis: { ...grid, range: [rows.length - 0.5, -0.5], tickvals: rows.map((_, i) => i), ticktext: rows.map(({ label }) => plain(label)), automargin: true } }, config);
      cursor(plot);
    });
  }
  // Printed charts have the width of a page of A4, which the browser knows only after it has drawn them.
  const printed = { multiple: [134, 104], chart: [690, 110] }, onScreen = new Map();
  addEventListener("topaper", () => document.querySelectorAll(".js-plotly-plot").forEach((plot) => {
    const [width, most] = printed[plot.classList.contains("multiple") ? "multiple" : "chart"];
    const height = plot.closest("#movement") ? most : plot.offsetHeight;
    onScreen.set(plot, plot.style.height);
    plot.style.height = `${height}px`;
    Plotly.relayout(plot, { width, height, "font.size": 8 });
  }));
  addEventListener("toscreen", () => onScreen.forEach((height, plot) => {
    plot.style.height = height;
    Plotly.relayout(plot, { width: null, height: null, autosize: true, "font.size": font.size });
  }));
