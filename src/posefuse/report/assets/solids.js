  // Shaded bodies on a floor with their shadow, drawn by three.js below the canvas of the scene. Without WebGL, and
  // through a camera with its lens, the canvas draws lines.
  function makeSolids() {
    const under = element("solids");
    const context = under.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    element("no-solids").hidden = Boolean(context);
    if (!context) return null;
    const renderer = new THREE.WebGLRenderer({ canvas: under, context, alpha: true, preserveDrawingBuffer: true });
    renderer.shadowMap.enabled = true;
    renderer.autoClear = false;
    renderer.setClearColor(0x000000, 0);
    const world = new THREE.Scene(), eye = new THREE.PerspectiveCamera();
    const up = new THREE.Vector3().setComponent(upIndex, upSign);
    const { size: bodySizes, radii, blobs, bare } = scene.bodies, people = scene.people.length, shownEdges = scene.edges.map((ends, e) => [...ends, e]).filter(([, , e]) => !bare.includes(e));
    const light = new THREE.DirectionalLight(0xffffff, 2.0), sky = new THREE.HemisphereLight(0xffffff, 0x8a8f96, 1.7);
    sky.position.copy(up);
    world.add(light, light.target, sky);
    aimLight();

    const mesh = (geometry, count, material) => {
      const made = new THREE.InstancedMesh(geometry, material, Math.max(count, 1));
      made.frustumCulled = false;
      made.castShadow = true;
      made.setColorAt(0, new THREE.Color());
      world.add(made);
      return made;
    };
    const matte = () => new THREE.MeshLambertMaterial();
    // A cylinder between two joints has the radius of each at its ends.
    const ends = new THREE.InstancedBufferAttribute(new Float32Array(2 * Math.max(people * shownEdges.length, 1)), 2);
    const taper = (material) => {
      material.onBeforeCompile = (shader) => {
        shader.vertexShader = `attribute vec2 ends;\n${shader.vertexShader}`.replace("#include <begin_vertex>",
          "#include <begin_vertex>\ntransformed.xz *= mix(ends.x, ends.y, position.y + 0.5);");
      };
      return material;
    };
    const limb = new THREE.CylinderGeometry(1, 1, 1, 14, 1, true);
    limb.setAttribute("ends", ends);
    const bones3d = mesh(limb, people * shownEdges.length, taper(matte()));
    bones3d.customDepthMaterial = taper(new THREE.MeshDepthMaterial());
    const joints = mesh(new THREE.SphereGeometry(1, 16, 12), people * K, matte());
    const trunks = mesh(new THREE.SphereGeometry(1, 28, 20), people * blobs.length, matte());
    const inEdge = new Set(shownEdges.flatMap(([a, b]) => [a, b]));

    // The floor takes the shadow; its grid has round cells.
    const floor = scene.up ? makeFloor() : null;
    function makeFloor() {
      const [i, j] = [0, 1, 2].filter((axis) => axis !== upIndex), margin = Math.max(cell, 0.6 * size);
      const range = (axis) => [Math.floor((bounds[axis][0] - margin) / cell) * cell, Math.ceil((bounds[axis][1] + margin) / cell) * cell];
      const [iRange, jRange] = [range(i), range(j)], lines = [];
      const at = (a, b) => { const p = [0, 0, 0]; p[i] = a; p[j] = b; p[upIndex] = groundAt; return p; };
      for (let a = iRange[0]; a <= iRange[1] + 1e-9; a += cell) lines.push(...at(a, jRange[0]), ...at(a, jRange[1]));
      for (let b = jRange[0]; b <= jRange[1] + 1e-9; b += cell) lines.push(...at(iRange[0], b), ...at(iRange[1], b));
      const grid = new THREE.LineSegments(geometryOf(lines), new THREE.LineBasicMaterial());
      const [p, q, r, s] = [at(iRange[0], jRange[0]), at(iRange[1], jRange[0]), at(iRange[1], jRange[1]), at(iRange[0], jRange[1])];
      const corners = geometryOf([...p, ...q, ...r, ...p, ...r, ...s]);
      corners.computeVertexNormals();
      const plate = new THREE.Mesh(corners, new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, transparent: true, opacity: 0.5, depthWrite: false }));
      const shadow = new THREE.Mesh(corners, new THREE.ShadowMaterial({ opacity: 0.3, side: THREE.DoubleSide, depthWrite: false }));
      shadow.receiveShadow = true;
      grid.renderOrder = 1;
      shadow.renderOrder = 2;
      world.add(plate, grid, shadow);
      return { grid, plate };
    }
    function geometryOf(positions) {
      return new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(positions), 3));
    }
    function aimLight() {
      const reach = 1.6 * size, middle = centerOf(bounds);
      light.target.position.set(...middle);
      const side = new THREE.Vector3().setComponent((upIndex + 1) % 3, 0.45).setComponent((upIndex + 2) % 3, 0.3);
      light.position.set(...middle).addScaledVector(up, 3 * reach).addScaledVector(side, 2 * reach);
      light.castShadow = Boolean(scene.up);
      light.shadow.mapSize.set(1024, 1024);
      light.shadow.radius = 3;
      light.shadow.normalBias = 0.002 * size;
      Object.assign(light.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1 * reach, far: 8 * reach });
    }
    // Cameras as pyramids; the one whose video is shown carries its image.
    const frustumLines = scene.cameras.flatMap(({ center, corners }) => corners.flatMap((corner, i) => [...center, ...corner, ...corner, ...corners[(i + 1) % 4]]));
    const frusta = new THREE.LineSegments(geometryOf(frustumLines), new THREE.LineBasicMaterial());
    const images = new THREE.Mesh(geometryOf(scene.cameras.flatMap(({ corners: [p, q, r, s] }) => [...p, ...q, ...r, ...p, ...r, ...s])),
      new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, transparent: true, opacity: 0.18, depthWrite: false }));
    world.add(frusta, images);

    // The path of each person over the last two seconds, as a ribbon on the floor.
    const TRAIL = Math.max(2, Math.min(240, Math.round(2 * scene.rate)));
    const trails = scene.people.map(() => {
      const material = new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, side: THREE.DoubleSide, depthWrite: false });
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * TRAIL), 3));
      geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(8 * TRAIL), 4));
      geometry.setIndex(Array.from({ length: TRAIL - 1 }, (_, n) => [2 * n, 2 * n + 1, 2 * n + 2, 2 * n + 1, 2 * n + 3, 2 * n + 2]).flat());
      const ribbon = new THREE.Mesh(geometry, material);
      ribbon.frustumCulled = false;
      ribbon.renderOrder = 3;
      world.add(ribbon);
      return ribbon;
    });

    const tint = {};
    function recolor() {
      const of = (text) => new THREE.Color(text);
      for (const name of ["left", "right", "middle", "paper"]) tint[name] = of(colors[name]);
      // Left is lighter than right: two colors of one hue for each person.
      tint.people = colors.people.map((text) => ({ middle: of(text), left: of(text).lerp(of("#ffffff"), 0.07), right: of(text).lerp(of("#000000"), 0.15) }));
      tint.skin = of(colors.skin);
      tint.ink = of(colors.ink);
      frusta.material.color = of(colors.faint);
      images.material.color = of(colors.faint);
      if (floor) { floor.grid.material.color = of(colors.line); floor.plate.material.color = of(colors.floor); }
    }
    recolor();
    const sideTint = (person, side) => several ? tint.people[person][side] : side === "middle" ? tint.skin : tint[side];
    const color = new THREE.Color(), matrix = new THREE.Matrix4(), spin = new THREE.Quaternion(), scale = new THREE.Vector3();
    const a3 = new THREE.Vector3(), b3 = new THREE.Vector3(), axis = new THREE.Vector3(), y = new THREE.Vector3(0, 1, 0), x3 = new THREE.Vector3(), z3 = new THREE.Vector3();
    // What was not measured in this frame is pale.
    const shade = (made, n, person, side, measured) => made.setColorAt(n, measured ? sideTint(person, side) : color.copy(sideTint(person, side)).lerp(tint.paper, 0.6));
    // Hands and faces contrast with the palm and the head behind them.
    const shadeFine = (made, n, person, side, measured) => measured
      ? made.setColorAt(n, color.copy(sideTint(person, side)).lerp(tint.ink, 0.55)) : shade(made, n, person, side, false);
    const isMeasured = (person, k) => mark(person, state.frame, k, 0) !== 2;

    function pose(layer) {
      let nBones = 0, nJoints = 0, nTrunks = 0;
      layer.points.forEach((points, person) => {
        const bodySize = bodySizes[person], place = (k) => at(points, state.frame, k);
        for (const [a, b, e] of shownEdges) {
          const p = place(a), q = place(b);
          if (!p || !q) continue;
          a3.set(...p);
          b3.set(...q);
          axis.subVectors(b3, a3);
          const length = axis.length();
          if (!(length > 0)) continue;
          spin.setFromUnitVectors(y, axis.divideScalar(length));
          matrix.compose(a3.add(b3).multiplyScalar(0.5), spin, scale.set(1, length, 1));
          bones3d.setMatrixAt(nBones, matrix);
          ends.setXY(nBones, bodySize * radii[a], bodySize * radii[b]);
          (isFine([a, b]) ? shadeFine : shade)(bones3d, nBones, person, edgeSides[e], isMeasured(person, a) && isMeasured(person, b));
          nBones += 1;
        }
        for (let k = 0; k < K; k++) {
          const p = place(k), r = bodySize * radii[k] * (inEdge.has(k) ? 1 : 0.6);
          if (!p) continue;
          joints.setMatrixAt(nJoints, matrix.makeScale(r, r, r).setPosition(...p));
          (fine.has(k) ? shadeFine : shade)(joints, nJoints, person, scene.sides[k], isMeasured(person, k));
          nJoints += 1;
        }
        for (const blob of blobs) nTrunks += trunk(blob, place, person, bodySize, nTrunks);
      });
      for (const [made, count] of [[bones3d, nBones], [joints, nJoints], [trunks, nTrunks]]) {
        made.count = count;
        made.instanceMatrix.needsUpdate = made.instanceColor.needsUpdate = true;
      }
      ends.needsUpdate = true;
    }
    function meanOf(indices, place, out) {
      out.set(0, 0, 0);
      for (const k of indices) {
        const p = place(k);
        if (!p) return false;
        out.x += p[0] / indices.length; out.y += p[1] / indices.length; out.z += p[2] / indices.length;
      }
      return indices.length > 0;
    }
    function trunk({ low, high, at: share, side, half }, place, person, bodySize, n) {
      if (!meanOf(low, place, a3) || !meanOf(high, place, b3)) return 0;
      axis.subVectors(b3, a3);
      const middle = a3.addScaledVector(axis, share);
      axis.normalize();
      x3.setComponent((upIndex + 1) % 3, 1);
      if (side.length === 2 && place(side[0]) && place(side[1])) x3.set(...place(side[1])).sub(z3.set(...place(side[0])));
      x3.addScaledVector(axis, -x3.dot(axis)).normalize();
      z3.crossVectors(x3, axis);
      matrix.makeBasis(x3, axis, z3).scale(scale.set(...half).multiplyScalar(bodySize)).setPosition(middle);
      trunks.setMatrixAt(n, matrix);
      shade(trunks, n, person, "middle", [...low, ...high].every((k) => isMeasured(person, k)));
      return 1;
    }
    function layTrails(layer) {
      trails.forEach((ribbon, person) => {
        ribbon.visible = Boolean(floor) && state.trails;
        if (!ribbon.visible) return;
        const { position, color: tone } = ribbon.geometry.attributes, of = sideTint(person, "middle"), half = 0.012 * bodySizes[person];
        const [i, j] = [0, 1, 2].filter((each) => each !== upIndex);
        let last = null, drawn = 0;
        for (let n = 0; n < TRAIL; n++) {
          const frame = state.frame - TRAIL + 1 + n, center = frame >= 0 && centerAt(layer.points[person], frame);
          if (!center) { drawn = 0; last = null; continue; }
          const along = last ? [center[i] - last[i], center[j] - last[j]] : [1, 0], norm = Math.hypot(...along) || 1;
          for (const s of [0, 1]) {
            const p = [0, 0, 0], sign = s ? -1 : 1;
            p[i] = center[i] - sign * half * along[1] / norm;
            p[j] = center[j] + sign * half * along[0] / norm;
            p[upIndex] = groundAt + upSign * 0.002 * size;
            position.setXYZ(2 * drawn + s, ...p);
            tone.setXYZW(2 * drawn + s, of.r, of.g, of.b, 0.75 * n / TRAIL);
          }
          drawn += 1;
          last = center;
        }
        ribbon.geometry.setDrawRange(0, Math.max(0, 6 * (drawn - 1)));
        position.needsUpdate = tone.needsUpdate = true;
      });
    }

    // Draw a layer in a pane of the free view.
    function draw(pane, layer) {
      pose(layer);
      layTrails(layer);
      const { ahead } = axesOf(), half = FOCAL * Math.min(pane.width, 1.4 * pane.height) / 2;
      eye.up.copy(up);
      eye.position.set(...state.target.map((v, i) => v - state.distance * ahead[i]));
      eye.fov = 2 * Math.atan(pane.height / 2 / half) * 180 / Math.PI;
      eye.aspect = pane.width / pane.height;
      eye.near = 0.02 * state.distance;
      eye.far = state.distance + 8 * radiusOf(boundsWithCameras);
      eye.lookAt(...state.target);
      eye.updateProjectionMatrix();
      const bottom = canvas.clientHeight - pane.y - pane.height;
      renderer.setViewport(pane.x, bottom, pane.width, pane.height);
      renderer.setScissor(pane.x, bottom, pane.width, pane.height);
      renderer.setScissorTest(true);
      renderer.clear();
      renderer.render(world, eye);
    }
    // Make the drawing as large as the canvas, and empty.
    function begin(width, height) {
      const ratio = Math.min(devicePixelRatio || 1, 2);
      if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
      const before = renderer.getSize(new THREE.Vector2());
      if (before.x !== width || before.y !== height) renderer.setSize(width, height, false);
      renderer.setScissorTest(false);
      renderer.clear();
    }
    // Draw the bodies below what the canvas of the scene shows.
    function underlay(above, width, height) {
      above.globalCompositeOperation = "destination-over";
      above.drawImage(under, 0, 0, width, height);
      above.globalCompositeOperation = "source-over";
    }
    return { begin, draw, recolor, underlay };
  }
  for (const turn of ["topaper", "toscreen"]) addEventListener(turn, () => draw());
  // The first frame is drawn as lines, because a context of WebGL can take long.
  if (!isPlanar) later(() => { runLibrary("three"); solids = makeSolids(); if (solids) { showTrailSwitch(); draw(); } });
