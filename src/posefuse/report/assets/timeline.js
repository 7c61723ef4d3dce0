  // The timeline below scene and video: when each person is there, gaps, left/right swaps, contact and error.
  const timeline = element("timeline"), strips = [], lastTime = Math.max(end, timeOf(nFrames - 1));
  const share = (time) => lastTime > first ? (time - first) / (lastTime - first) : 0;
  const starts01 = series.time.map(share), stop01 = (i) => i + 1 < starts01.length ? starts01[i + 1] : 1;
  function strip(title, description, height, paint) {
    const row = document.createElement("div"), name = document.createElement("span"), sheet = document.createElement("canvas");
    row.className = "strip";
    name.textContent = title;
    sheet.style.height = `${height}px`;
    sheet.setAttribute("role", "img");
    sheet.setAttribute("aria-label", description);
    row.append(name, sheet);
    timeline.append(row);
    strips.push({ sheet, paint });
  }
  function paintStrips() {
    for (const { sheet, paint } of strips) {
      const ratio = devicePixelRatio || 1, width = sheet.clientWidth, height = sheet.clientHeight, ink = sheet.getContext("2d");
      if (!width) continue;
      sheet.width = Math.round(width * ratio);
      sheet.height = Math.round(height * ratio);
      ink.setTransform(ratio, 0, 0, ratio, 0, 0);
      ink.fillStyle = css("--wash");
      ink.fillRect(0, 0, width, height);
      const bar = (from, to, low, high, color, alpha = 1) => {
        ink.globalAlpha = alpha;
        ink.fillStyle = color;
        const left = Math.floor(from * width), right = Math.max(Math.ceil(to * width), left + 1);
        ink.fillRect(left, height * (1 - high), right - left, height * (high - low));
        ink.globalAlpha = 1;
      };
      paint(bar, ink, width, height);
    }
  }
  const personColor = (p) => several ? colorOf(p) : css("--left");
  // The bar is as high as the share of the person's keypoints that were measured.
  function paintPerson(p, bar) {
    series.frameIndex.forEach((_, i) => {
      let there = 0, measured = 0;
      for (const codes of series.states[p]) { there += codes[i] !== "3"; measured += codes[i] === "1"; }
      if (!there) return;
      bar(starts01[i], stop01(i), 0.1, 0.9, personColor(p), 0.25);
      bar(starts01[i], stop01(i), 0.1, 0.1 + 0.8 * measured / there, personColor(p));
    });
  }
  // How many of the keypoints of the people who are there have no measurement.
  function paintGaps(bar) {
    series.frameIndex.forEach((_, i) => {
      let there = 0, filled = 0, missing = 0;
      for (const person of series.states) for (const codes of person) { there += codes[i] !== "3"; filled += codes[i] === "2"; missing += codes[i] === "0"; }
      if (!there) return;
      bar(starts01[i], stop01(i), 0, missing / there, css("--missing"));
      bar(starts01[i], stop01(i), missing / there, (missing + filled) / there, css("--filled"));
    });
  }
  function paintSwaps(bar) {
    swaps.time.forEach((time, i) => {
      const most = Math.max(0, ...swaps.share.map((row) => row[i] ?? 0));
      if (most > 0) bar(share(time), i + 1 < swaps.time.length ? share(swaps.time[i + 1]) : 1, 0, most, css("--right"));
    });
  }
  function paintContact(bar) {
    const rows = movement.contact;
    rows.forEach(({ side, spans }, r) => spans.forEach(([from, to]) =>
      bar(share(from), share(to), 1 - (r + 0.85) / rows.length, 1 - (r + 0.15) / rows.length, css(sideColor[side]))));
  }
  function paintError(_, ink, width, height) {
    const top = Math.max(series.highestError ?? 0, 1e-6);
    series.error.forEach((values, p) => {
      ink.strokeStyle = personColor(p);
      ink.lineWidth = 1.5;
      ink.beginPath();
      let drawing = false;
      values.forEach((v, i) => {
        if (v === null) { drawing = false; return; }
        const x = starts01[i] * width, level = height - 2 - v / top * (height - 5);
        if (drawing) ink.lineTo(x, level); else ink.moveTo(x, level);
        drawing = true;
      });
      ink.stroke();
    });
  }
  const MOST_PEOPLE = 12;
  if (nFrames > 1 && series.states.length) {
    scene.people.slice(0, MOST_PEOPLE).forEach((name, p) => strip(name, `When ${name} is there, and the share of keypoints that were measured`, 16, (bar) => paintPerson(p, bar)));
    if (series.states.some((person) => person.some((codes) => /[02]/.test(codes)))) strip("gaps", "Share of keypoints that were filled or are missing", 16, paintGaps);
    if (swaps && swaps.share.some((row) => row.some((v) => v > 0))) strip("left/right swaps", "Share of swapped detections of the camera with most of them", 16, paintSwaps);
    if (movement?.contact) strip("foot contact", "When heels and toes touch the ground", 6 * movement.contact.length, paintContact);
    if (series.highestError !== null) strip(`error ≤ ${series.highestError.toFixed(1)} px`, "Reprojection error of each person", 36, paintError);
  }
  timeline.hidden = !strips.length;
  if (strips.length) {
    const mark = Object.assign(document.createElement("div"), { className: "now" });
    timeline.prepend(mark);
    const track = () => strips[0].sheet;
    const placeMark = () => {
      const left = track().offsetLeft, width = track().clientWidth;
      mark.style.left = `${left + width * share(timeOf(state.frame))}px`;
    };
    const seek = (event) => {
      const { left, width } = track().getBoundingClientRect(), time = first + (lastTime - first) * Math.max(0, Math.min(1, (event.clientX - left) / width));
      let nearest = 0;
      for (let frame = 0; frame < nFrames; frame++) if (Math.abs(timeOf(frame) - time) < Math.abs(timeOf(nearest) - time)) nearest = frame;
      show(nearest);
    };
    timeline.addEventListener("pointerdown", (event) => {
      if (event.target.tagName !== "CANVAS") return;
      event.target.setPointerCapture(event.pointerId);
      seek(event);
    });
    timeline.addEventListener("pointermove", (event) => { if (event.buttons && event.target.tagName === "CANVAS") seek(event); });
    frameListeners.push(placeMark);
    new ResizeObserver(() => { paintStrips(); placeMark(); }).observe(timeline);
    addEventListener("themechange", paintStrips);
  }
