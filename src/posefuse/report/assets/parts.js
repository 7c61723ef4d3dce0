  // Body parts of skeletons with hands and a face: tables and charts of all their keypoints are folded by part.
  const parts = charts.keypoint_groups.map(([name, keypoints]) => ({ name, keypoints })), folded = parts.length > 1;
  const partTitle = ({ name, keypoints }) => `${name}: ${keypoints.length} keypoints`;
  // A chart below its title, drawn when it is first open.
  function foldPart(title, plot, open, drawPlot) {
    const fold = document.createElement("details");
    fold.append(Object.assign(document.createElement("summary"), { textContent: title }), plot);
    fold.addEventListener("toggle", () => { if (fold.open && !plot.firstChild) later(drawPlot); });
    fold.open = open;
    return fold;
  }
