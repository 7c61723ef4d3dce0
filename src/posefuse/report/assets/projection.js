  // Camera projection with the lens models and validity limits of the reconstruction.
  function projectThrough({ matrix, pose, lens, distortion, maxRadius }, p) {
    const [x, y, z] = [0, 4, 8].map((i) => pose[i] * p[0] + pose[i + 1] * p[1] + pose[i + 2] * p[2] + pose[i + 3]);
    const distorted = lens === "fisheye" ? distortFisheye(distortion, maxRadius, x, y, z) : distortPinhole(distortion, maxRadius, x, y, z);
    return distorted && [matrix[0] * distorted[0] + matrix[1] * distorted[1] + matrix[2], matrix[4] * distorted[1] + matrix[5], Math.hypot(x, y, z)];
  }
  function distortFisheye([k1 = 0, k2 = 0, k3 = 0, k4 = 0], maxRadius, x, y, z) {
    const rho = Math.hypot(x, y), theta = Math.atan2(rho, z), t = theta * theta;
    if (maxRadius !== null && theta > maxRadius) return null;
    const scale = rho > 0 ? theta * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4)))) / rho : 0;
    return [scale * x, scale * y];
  }
  function distortPinhole([k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0], maxRadius, x, y, z) {
    if (!(z > 0)) return null;
    const u = x / z, v = y / z, r = u * u + v * v;
    if (maxRadius !== null && r > maxRadius * maxRadius) return null;
    const radial = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)));
    return [u * radial + 2 * p1 * u * v + p2 * (r + 2 * u * u), v * radial + p1 * (r + 2 * v * v) + 2 * p2 * u * v];
  }
