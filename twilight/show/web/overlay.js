// What is drawn over the sky: directions along the horizon, the sun's path, names on both sides of the line.
const overlay = byId("overlay");

// Whether azimuths count from north; else from the sun.
const fromNorth = () => state.mode === "clock" || HEAD.sun_azimuth_deg != null;
const COMPASS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

// An azimuth as the picture counts it: clockwise from north, or to both sides of the sun.
const pictured = (azimuth) => (fromNorth() ? around(azimuth, 360) : around(azimuth - theSun().azimuth + 180, 360) - 180);
const azimuthText = (azimuth) => `azimuth ${minus(pictured(azimuth).toFixed(2))}°`
  + (fromNorth() ? ` (${COMPASS[Math.round(azimuth / 45) % 8]})` : " from the sun's");

function drawOverlay(sun) {
  const ratio = canvas.width / canvas.clientWidth || 1;
  overlay.width = canvas.width;
  overlay.height = canvas.height;
  const pen = overlay.getContext("2d"), w = overlay.width, h = overlay.height, aspect = w / h;
  const at = (d) => { const p = placeOf(d, aspect); return p && [(p[0] + 1) / 2 * w, (1 - p[1]) / 2 * h]; };
  pen.font = `${12 * ratio}px system-ui, sans-serif`;
  pen.textAlign = "center";
  pen.shadowColor = "#000";
  pen.shadowBlur = 3 * ratio;
  if (state.labels) {
    pen.fillStyle = "#fffc";
    for (let k = 0; k < 8; k++) {
      const p = at(direction(horizonOf(0), 45 * k));
      if (p && p[0] > 0 && p[0] < w && p[1] > 0 && p[1] < h) pen.fillText(fromNorth() ? COMPASS[k] : k === 0 ? "sun's azimuth" : minus(`${k > 4 ? 45 * k - 360 : 45 * k}°`), p[0], Math.min(p[1] + 16 * ratio, h - 4));
    }
  }
  if (state.path && state.mode === "clock") drawPath(pen, at, ratio, Math.max(w, h));
  if (HEAD.fields.length > 1) {
    const x = state.split * w;
    pen.fillStyle = "#fff";
    pen.textAlign = "right";
    pen.fillText(HEAD.names[0], x - 12 * ratio, 20 * ratio);
    pen.textAlign = "left";
    pen.fillText(HEAD.names[1], x + 12 * ratio, 20 * ratio);
  }
}

function drawPath(pen, at, ratio, size) {
  const start = daysSince(state.date, 0, state.zone);
  pen.strokeStyle = "#fd8c";
  pen.lineWidth = 1.2 * ratio;
  pen.beginPath();
  let before = null;
  for (let i = 0; i <= 288; i++) {
    const s = sunAt(start + i / 288, state.latitude, state.longitude), p = s.elevation > -18 ? at(direction(s.elevation, s.azimuth)) : null;
    if (p && before && Math.hypot(p[0] - before[0], p[1] - before[1]) < size / 3) pen.lineTo(...p);
    else if (p) pen.moveTo(...p);
    before = p;
  }
  pen.stroke();
  pen.fillStyle = "#fd8";
  for (let hour = 0; hour < 24; hour++) {
    const s = sunAt(start + hour / 24, state.latitude, state.longitude), p = s.elevation > -18 && at(direction(s.elevation, s.azimuth));
    if (!p) continue;
    pen.beginPath();
    pen.arc(p[0], p[1], 2.5 * ratio, 0, 2 * Math.PI);
    pen.fill();
    pen.fillText(`${hour}`, p[0], p[1] - 6 * ratio);
  }
}
