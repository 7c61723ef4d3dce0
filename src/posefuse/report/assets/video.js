  // Small copies of the videos beside the scene: the skeleton of the shown layer is drawn on the image that is shown.
  const films = videos.films, film = element("film"), video = element("video"), sheet = element("video-canvas");
  let filmed = -1;
  // The time of a frame in the result, on the clock of all films.
  const resultTime = (frame) => scene.time ? scene.time[frame] : videos.start + (scene.frames[frame] - scene.frames[0]) * videos.period;
  function frameAt(time) {
    let low = 0, high = nFrames - 1;
    while (high - low > 1) { const middle = low + high >> 1; if (resultTime(middle) <= time) low = middle; else high = middle; }
    return Math.abs(resultTime(high) - time) < Math.abs(resultTime(low) - time) ? high : low;
  }
  // Half an image later, so that the shown image is the nearest one.
  const targetTime = (frame) => Math.max(0, resultTime(frame) - films[filmed].first + 0.5 / films[filmed].rate);
  function openFilm(i) {
    if (i < 0 || i >= films.length) return;
    filmed = i;
    const { content, link } = films[i];
    if (!films[i].url) films[i].url = link || URL.createObjectURL(new Blob([bytesOf(content)], { type: "video/mp4" }));
    video.setAttribute("src", films[i].url);
    video.setAttribute("aria-label", `Video of ${scene.cameras[films[i].camera].name}`);
    element("video-frame").style.setProperty("--aspect", films[i].size[0] / films[i].size[1]);
    [...element("film-cameras").children].forEach((button, k) => button.setAttribute("aria-pressed", String(k === i)));
    element("video-problem").hidden = true;
    video.load();
    follow();
  }
  function follow() {
    if (filmed < 0) return;
    const target = targetTime(state.frame), speed = Number(element("speed").value);
    if (!playing) {
      // A video that was playing is further than the time that it states, which scripts see once per task.
      const moved = !video.paused;
      video.pause();
      if (moved || Math.abs(video.currentTime - target) > 1e-4) video.currentTime = target;
      drawFilm(state.frame);
      return;
    }
    video.playbackRate = speed;
    if (Math.abs(video.currentTime - target) > Math.max(0.12, 0.12 * speed)) video.currentTime = target;
    if (video.paused && target < video.duration) video.play().catch(() => {});
    if (!video.requestVideoFrameCallback) drawFilm(state.frame);
  }
  // While the film plays, the skeleton is that of the image on the screen, not that of the scene.
  function onImage(_, { mediaTime }) {
    if (playing) drawFilm(frameAt(mediaTime + films[filmed].first));
    video.requestVideoFrameCallback(onImage);
  }
  function drawFilm(frame) {
    const width = sheet.clientWidth, height = sheet.clientHeight, ratio = devicePixelRatio || 1, ink = sheet.getContext("2d");
    if (!width) return;
    sheet.width = Math.round(width * ratio);
    sheet.height = Math.round(height * ratio);
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    sheet.dataset.frame = String(scene.frames[frame]);
    const camera = scene.cameras[films[filmed].camera], [xScale, yScale] = [width / films[filmed].area[0], height / films[filmed].area[1]];
    const place = (points, k) => {
      const p = at(points, frame, k), pixel = p && projectThrough(camera, p);
      return pixel && [xScale * (pixel[0] + 0.5), yScale * (pixel[1] + 0.5)];
    };
    layers[state.layer].points.forEach((points, person) => {
      const places = scene.keypoints.map((_, k) => place(points, k));
      ink.lineCap = "round";
      // A dark edge keeps the lines visible on any image.
      for (const [colorOf, thickness] of [[() => "rgba(0,0,0,0.55)", 5], [(e) => edgeColor(person, e), 2.5]]) scene.edges.forEach(([a, b], e) => {
        if (!places[a] || !places[b]) return;
        ink.strokeStyle = colorOf(e);
        ink.lineWidth = thickness * (isFine([a, b]) ? 0.4 : 1);
        ink.beginPath();
        ink.moveTo(...places[a]);
        ink.lineTo(...places[b]);
        ink.stroke();
      });
      places.forEach((q, k) => {
        if (!q) return;
        ink.strokeStyle = keypointColor(person, k);
        ink.fillStyle = mark(person, frame, k, 0) === 2 ? colors.paper : ink.strokeStyle;
        ink.lineWidth = 1;
        ink.beginPath();
        ink.arc(q[0], q[1], fine.has(k) ? 0.8 : 2.4, 0, 7);
        ink.fill();
        ink.stroke();
      });
      const top = several && places.filter(Boolean).sort((a, b) => a[1] - b[1])[0];
      if (top) {
        ink.font = "600 12px system-ui, sans-serif";
        ink.textAlign = "center";
        ink.lineWidth = 3;
        ink.strokeStyle = "rgba(0,0,0,0.7)";
        ink.strokeText(scene.people[person], top[0], Math.max(top[1] - 9, 12));
        ink.fillStyle = "#ffffff";
        ink.fillText(scene.people[person], top[0], Math.max(top[1] - 9, 12));
      }
    });
  }
  if (films.length && scene.cameras.length) {
    film.hidden = false;
    element("scene-section").classList.add("with-film");
    document.body.classList.add("wide-page");
    films.forEach(({ camera }, i) => {
      const button = document.createElement("button");
      button.textContent = scene.cameras[camera].name;
      button.addEventListener("click", () => openFilm(i));
      element("film-cameras").append(button);
    });
    video.addEventListener("loadedmetadata", follow);
    video.addEventListener("pause", () => { if (!playing) follow(); });
    video.addEventListener("seeked", () => { if (!playing) drawFilm(state.frame); });
    video.addEventListener("error", () => { element("video-problem").hidden = false; });
    if (video.requestVideoFrameCallback) video.requestVideoFrameCallback(onImage);
    frameListeners.push(follow);
    playListeners.push(follow);
    element("layer").addEventListener("change", () => drawFilm(state.frame));
    element("view").addEventListener("change", () => openFilm(films.findIndex(({ camera }) => camera === state.camera)));
    addEventListener("resize", () => drawFilm(state.frame));
    addEventListener("themechange", () => drawFilm(state.frame));
    openFilm(0);
    redraw();
  } else if (element("video-note").textContent) {
    // No video can be shown; the reasons are.
    film.hidden = false;
    element("video-frame").hidden = true;
  }
