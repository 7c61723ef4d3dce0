  // Start of the page of a calibration: the free view shows all cameras and the filmed volume.
  function fitAll() {
    const { right, down, ahead } = axesOf(), width = canvas.clientWidth, height = canvas.clientHeight;
    const shown = [...scene.volume.points, ...scene.cameras.flatMap(({ center, corners }) => [center, ...corners])];
    const range = (axis) => { const of = shown.map((p) => dot(p, axis)); return (Math.min(...of) + Math.max(...of)) / 2; };
    const [x, y, z] = [right, down, ahead].map(range);
    state.target = [0, 1, 2].map((i) => x * right[i] + y * down[i] + z * ahead[i]);
    const focal = 1.12 * FOCAL * Math.min(width, 1.4 * height);
    state.distance = Math.max(...shown.map((p) => minus(p, state.target)).map(
      (d) => Math.max(focal / width * Math.abs(dot(d, right)), focal / height * Math.abs(dot(d, down))) - dot(d, ahead)));
  }
  fitAll();
  fit.addEventListener("click", () => { if (state.wide) fitAll(); });
  show(0);
