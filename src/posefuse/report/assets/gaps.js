  // When points were measured, filled and missing: one chart per body part.
  let gapPerson = 0;
  const isGapCode = (code) => code === "0" || code === "2";
  function gapRows(keypoints) {
    return keypoints.map((k) => Array.from(series.states[gapPerson][k], (code) => code === "3" ? null : Number(code)));
  }
  function drawGaps(plot, keypoints) {
    const made = Boolean(plot.data), rows = gapRows(keypoints), names = keypoints.map((k) => scene.keypoints[k]), n = keypoints.length;
    const [missing, measured, filled] = ["--missing", "--measured", "--filled"].map(css);
    const words = ["missing", "measured", "filled or held"];
    plot.style.height = `${70 + (n > 40 ? 11 : 16) * n}px`;
    Plotly.react(plot, [{ type: "heatmap", x: series.time, y: names.map((_, i) => i), z: rows, zmin: 0, zmax: 2, ygap: 1, showscale: false,
      colorscale: [[0, missing], [0.33, missing], [0.33, measured], [0.67, measured], [0.67, filled], [1, filled]], hoverongaps: false,
      customdata: rows.map((row, i) => row.map(() => names[i])), text: rows.map((row) => row.map((code) => words[code] ?? "")),
      hovertemplate: "%{customdata}, %{x:.2f}: %{text}<extra></extra>" }],
    { ...base, margin: { l: 120, r: 10, t: 10, b: 40 }, xaxis: timeAxis,
      yaxis: { autorange: "reversed", automargin: true, tickvals: names.map((_, i) => i), ticktext: names.map(plain), tickfont: { size: n > 40 ? 9 : 12 } } }, config);
    if (!made) cursor(plot);
  }
  // The share of gaps in a part states whether it is worth opening.
  function gapTitle(part) {
    const codes = part.keypoints.flatMap((k) => Array.from(series.states[gapPerson][k])).filter((code) => code !== "3");
    return `${partTitle(part)}, ${percent(codes.length ? codes.filter(isGapCode).length / codes.length : 0)} filled or missing`;
  }
  function gapCharts(place) {
    if (!folded) return [{ part: parts[0], plot: place, fold: null }];
    const description = place.getAttribute("aria-label");
    place.removeAttribute("role");
    place.removeAttribute("aria-label");
    return parts.map((part, i) => {
      const plot = document.createElement("div");
      plot.className = "gap-part";
      plot.setAttribute("role", "img");
      plot.setAttribute("aria-label", `${description}: ${part.name}`);
      const fold = foldPart(gapTitle(part), plot, i === 0, () => drawGaps(plot, part.keypoints));
      place.append(fold);
      return { part, plot, fold };
    });
  }
  if (element("gaps") && series.states.length) {
    const shown = gapCharts(element("gaps"));
    if (!folded) later(() => drawGaps(shown[0].plot, shown[0].part.keypoints));
    if (several) {
      const menu = document.createElement("select");
      menu.setAttribute("aria-label", "Subject");
      scene.people.forEach((name, i) => menu.append(new Option(name, i)));
      menu.addEventListener("change", () => {
        gapPerson = Number(menu.value);
        for (const { part, plot, fold } of shown) {
          if (fold) fold.firstChild.textContent = gapTitle(part);
          if (plot.data) drawGaps(plot, part.keypoints);
        }
      });
      element("gap-people").append(menu);
    }
  }
