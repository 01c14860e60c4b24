// A click: luminance, magnitude, chromaticity and spectrum in a direction.
let probed = null;   // direction that was clicked

function probe(x, y) {
  probed = rayAt(x, y, canvas.width / canvas.height);
  byId("probe").hidden = probed === null;
  redraw();
}

// Figures of a direction that is in the picture; null: it is not.
function figuresOf(d) {
  const p = placeOf(d, canvas.width / canvas.height);
  if (!p || Math.max(Math.abs(p[0]), Math.abs(p[1])) > 1) return null;
  const x = clamp(Math.floor((p[0] + 1) / 2 * canvas.width), 0, canvas.width - 1);
  const y = clamp(Math.floor((p[1] + 1) / 2 * canvas.height), 0, canvas.height - 1);
  const [X, Y, Z, scotopic] = readLight(targets.light, x, y, 1, 1), sum = X + Y + Z;
  const field = p[0] < 2 * splitAt() - 1 ? 0 : 1;
  return {
    elevation: elevationOf(d), azimuth: pictured(azimuthOf(d)), luminance: Y, scotopic,
    magnitude: -2.5 * Math.log10(Y / 10.8e4), x: X / sum, y: Y / sum,
    wavelength_nm: HEAD.fields[field].wavelength_nm, spectrum: spectrumOf(d, field), name: HEAD.names[field],
  };
}

// Spectral radiance [W m^-2 sr^-1 nm^-1] of air, ground and night at the wavelengths of the field; discs are not in it.
function spectrumOf(d, field) {
  const sun = theSun(), moon = theMoon(sun), bySun = factorUnder(d, field, sun), near = 1 / (HEAD.distance_au ?? sun.distance) ** 2;
  const byMoon = moon?.lights ? factorUnder(d, field, moon) : null, over = moon ? moonlight(moon, field, "moon_spectrum") : [];
  const e = elevationOf(d), h = horizonOf(field), up = e >= h;
  const u = inSpace() ? lineHeight(d, field) : Math.sqrt(clamp((e - h) / (90 - h), 0, 1));
  const night = state.night && HEAD.kind === "field" ? nightSpectrum(field, up, u, d, celestial(sun)) : null;
  return HEAD.fields[field].solar_irradiance.map((f, b) => f * (near * bySun[b] + (byMoon ? over[b] * byMoon[b] : 0)) + (night ? night[b] : 0));
}

// Radiance over the irradiance of a body at 1 au [sr^-1], at the wavelengths of the field.
function factorUnder(d, field, sun) {
  const foot = inSpace() ? footOf(d, field, sun) : null, f = HEAD.fields[field], grid = HEAD.kind !== "field";
  const e = elevationOf(d), h = horizonOf(field), beside = around(azimuthOf(d) - sun.azimuth, 360);
  if (inSpace() ? !foot : grid && e < h) return f.wavelength_nm.map(() => 0);
  const values = foot ? underSun(`space_spectrum${field}`, foot.sun, f.space_spectrum_sun_deg) : underSun(`spectrum${field}`, sun.shown, f.spectrum_sun_deg);
  const kept = (foot ? HEAD.space : HEAD).spectrum_rows, rows = grid ? HEAD.spectrum_row_deg : kept.map((i) => rowsOf(field)[i]);
  const columns = (foot ? HEAD.space : HEAD).spectrum_column_deg, bands = f.wavelength_nm.length;
  const across = stencil(columns, foot ? foot.azimuth : grid ? beside : Math.min(beside, 360 - beside));
  const logs = new Array(bands).fill(0);
  for (const [j, v] of stencil(rows, foot ? foot.row : e)) {
    for (const [i, w] of across) for (let b = 0; b < bands; b++) logs[b] += v * w * values[(j * columns.length + i) * bands + b];
  }
  return logs.map((log) => (foot ? foot.edge : 1) * Math.exp(log));
}

function drawProbe() {
  if (!probed || byId("probe").hidden) return;
  const f = figuresOf(probed);
  if (!f) { byId("probe-text").textContent = "not in the picture"; return; }
  byId("probe-text").textContent = `${f.name}: elevation ${minus(f.elevation.toFixed(2))}°\n${azimuthText(f.azimuth)}\n`
    + `${f.luminance.toPrecision(4)} cd m⁻²,  ${f.magnitude.toFixed(2)} mag arcsec⁻²\n`
    + `x = ${f.x.toFixed(4)}, y = ${f.y.toFixed(4)}`;
  drawSpectrum(f);
}

function drawSpectrum(f) {
  const c = byId("probe-spectrum"), pen = c.getContext("2d"), [left, bottom, w, h] = [40, 110, 250, 95];
  const [low, high] = [f.wavelength_nm[0], f.wavelength_nm[f.wavelength_nm.length - 1]], most = Math.max(...f.spectrum);
  const x = (nm) => left + (high > low ? (nm - low) / (high - low) : 0.5) * w, y = (v) => bottom - v / most * h;
  pen.clearRect(0, 0, c.width, c.height);
  pen.strokeStyle = pen.fillStyle = "#9bc";
  pen.strokeRect(left, bottom - h, w, h);
  pen.font = "10px system-ui, sans-serif";
  pen.textAlign = "center";
  f.wavelength_nm.forEach((nm, i) => { if (i % 2 === 0 || f.wavelength_nm.length < 8) pen.fillText(`${Math.round(nm)}`, x(nm), bottom + 12); });
  pen.fillText("nm", left + w / 2, bottom + 20);
  pen.textAlign = "right";
  pen.fillText(most.toExponential(1), left - 2, bottom - h + 8);
  pen.fillText("0", left - 2, bottom);
  pen.save();
  pen.translate(8, bottom - h / 2);
  pen.rotate(-Math.PI / 2);
  pen.textAlign = "center";
  pen.fillText("W m⁻² sr⁻¹ nm⁻¹", 0, 0);
  pen.restore();
  pen.strokeStyle = "#fff";
  pen.lineWidth = 1.5;
  pen.beginPath();
  f.wavelength_nm.forEach((nm, i) => (i ? pen.lineTo(x(nm), y(f.spectrum[i])) : pen.moveTo(x(nm), y(f.spectrum[i]))));
  pen.stroke();
  pen.lineWidth = 1;
}
