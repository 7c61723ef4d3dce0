  // Heat map of cameras by keypoints: each cell links to its worst frames.
  const heat = element("heat"), quantity = element("quantity"), worst = element("worst");
  const views = charts.views;
  const known = heatMap.error.flat().filter((v) => v !== null).sort((a, b) => a - b);
  const medianError = (known.length ? known[known.length >> 1] : 1) || 1;
  const percent = (share) => `${(100 * share).toFixed(share > 0 && share < 0.0995 ? 1 : 0)} %`;
  const formatQuantity = (name, value) => value === null ? "–" : name === "error" ? value.toFixed(value < 9.95 ? 2 : 1) : percent(value);
  const heatValue = (name, value) => value === null ? 0 : Math.round(100 * Math.max(0, Math.min(1, name === "error" ? (value / medianError - 0.6) / 1.6 : value)));
  const hueOf = { error: "--right", rejected: "--right", missing: "--missing", used: "--left" };
  // Rows in their order on the page, and the cells of each keypoint.
  const heatOrder = parts.flatMap(({ keypoints }) => keypoints), heatCells = [];
  function buildHeatMap() {
    const head = heat.createTHead().insertRow();
    for (const name of ["Keypoint", ...views]) head.append(Object.assign(document.createElement("th"), { textContent: name, scope: "col" }));
    parts.forEach((part, i) => {
      const body = heat.createTBody();
      if (folded) addPartRow(body, part, i > 0);
      part.keypoints.forEach((k) => addHeatRow(body, k));
    });
    heat.querySelector("td").tabIndex = 0;
  }
  function addHeatRow(body, k) {
    const row = body.insertRow();
    row.append(Object.assign(document.createElement("th"), { textContent: scene.keypoints[k], scope: "row" }));
    heatCells[k] = views.map((_, v) => {
      const cell = row.insertCell();
      cell.setAttribute("role", "gridcell");
      cell.tabIndex = -1;
      cell.dataset.keypoint = k;
      cell.dataset.view = v;
      return cell;
    });
  }
  // The first row of a body part folds and unfolds it.
  function addPartRow(body, part, isFolded) {
    const title = Object.assign(document.createElement("th"), { scope: "rowgroup", colSpan: views.length + 1 });
    const button = Object.assign(document.createElement("button"), { className: "fold", type: "button", textContent: partTitle(part) });
    const turn = (hide) => { body.classList.toggle("folded", hide); button.setAttribute("aria-expanded", String(!hide)); };
    button.addEventListener("click", () => { turn(!body.classList.contains("folded")); keepReachable(); makeScrollable(); });
    title.append(button);
    body.insertRow().append(title);
    turn(isFolded);
  }
  const isShown = (cell) => !cell.closest("tbody").classList.contains("folded");
  // The keyboard reaches one cell, which must be visible.
  function keepReachable() {
    const before = heat.querySelector("td[tabindex='0']"), next = heatOrder.map((k) => heatCells[k][0]).find(isShown);
    if (!next || isShown(before)) return;
    before.tabIndex = -1;
    next.tabIndex = 0;
  }
  function colorHeatMap() {
    const name = quantity.value;
    heat.style.setProperty("--hue", `var(${hueOf[name]})`);
    heatCells.forEach((row, k) => row.forEach((cell, v) => {
      const value = heatMap[name][k][v];
      cell.textContent = formatQuantity(name, value);
      cell.style.setProperty("--heat", `${heatValue(name, value)}%`);
      cell.setAttribute("aria-label", `${scene.keypoints[k]}, ${views[v]}: ${cell.textContent}`);
    }));
  }
  // The worst frames of the share used are those with the largest errors.
  const linksOf = (k, v) => heatMap.worst[quantity.value === "used" ? "error" : quantity.value][k][v];
  function selectCell(cell) {
    const k = Number(cell.dataset.keypoint), v = Number(cell.dataset.view), links = linksOf(k, v);
    heat.querySelector(".chosen")?.classList.remove("chosen");
    cell.classList.add("chosen");
    worst.replaceChildren(`${scene.keypoints[k]} in ${views[v]}: `);
    if (!links.length) { worst.append("no frames."); return; }
    for (const [frameIndex, number, person, px] of links) {
      const button = Object.assign(document.createElement("button"), { className: "go",
        textContent: `frame ${number}${several ? `, ${scene.people[person]}` : ""}${px === null ? "" : `, ${px} px`}` });
      Object.assign(button.dataset, { frameIndex, person, keypoint: k, view: v });
      worst.append(button, " ");
    }
    const [frameIndex, , person] = links[0];
    jumpTo(frameIndex, { person, keypoint: k, view: v }, cell);
  }
  function moveSelection(from, dk, dv) {
    const rows = heatOrder.filter((k) => isShown(heatCells[k][0])), row = rows.indexOf(Number(from.dataset.keypoint));
    const next = heatCells[rows[row + dk]]?.[Number(from.dataset.view) + dv];
    if (!next) return;
    from.tabIndex = -1;
    next.tabIndex = 0;
    next.focus();
  }
  buildHeatMap();
  colorHeatMap();
  quantity.addEventListener("change", colorHeatMap);
  heat.addEventListener("click", (event) => {
    const cell = event.target.closest("td");
    if (!cell) return;
    heat.querySelector("td[tabindex='0']").tabIndex = -1;
    cell.tabIndex = 0;
    selectCell(cell);
  });
  heat.addEventListener("keydown", (event) => {
    const cell = event.target.closest("td");
    const move = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key];
    if (!cell) return;
    if (move) { event.preventDefault(); moveSelection(cell, ...move); }
    if (event.key === "Enter" || event.key === " ") { event.preventDefault(); selectCell(cell); }
  });
