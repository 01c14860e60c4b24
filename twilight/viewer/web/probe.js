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
  const t = HEAD.texels, foot = inSpace() ? footOf(d, field, sun) : null;
  const name = `${inSpace() ? "space_" : ""}spectrum${field}`, shape = HEAD.arrays[name].shape;
  const values = underSun(name, foot?.sun ?? sun.shown), bands = shape[0], rows = shape[3], columns = shape[4];
  const e = elevationOf(d), away = around(azimuthOf(d) - sun.azimuth, 360), h = horizonOf(field), up = e >= h;
  let y, x, low = 0, high = rows - 1;
  if (HEAD.kind === "sky") {
    if (!up) return new Array(bands).fill(0);
    y = e / 90 * (rows - 1);
    x = away / 360 * columns;
  } else if (inSpace()) {
    if (foot) {
      const ground = (t.ground + 1) / 2;
      [low, high] = foot.ground ? [0, ground - 1] : [ground, rows - 1];
      y = foot.ground ? foot.y / 2 : ground + (foot.y - t.ground) / 2;
      x = (foot.azimuth / 180) ** (1 / HEAD.azimuth_power) * (columns - 1);
    } else [x, y] = [0, 0];
  } else {
    const ground = (t.ground + 1) / 2;
    [low, high] = up ? [ground, rows - 1] : [0, ground - 1];
    y = up ? low + rowAbove(e, h, hazeOf(field), 90, 2, t.haze, t.sky) / 2 : (1 - Math.sqrt(clamp((h - e) / (90 + h), 0, 1))) * high;
    x = (Math.min(away, 360 - away) / 180) ** (1 / HEAD.azimuth_power) * (columns - 1);
  }
  const j = clamp(Math.floor(y), low, high - 1), v = y - j;
  const i = HEAD.kind === "sky" ? Math.floor(x) : Math.min(Math.floor(x), columns - 2), w = x - i;
  const at = (row, column, b) => values[(row * columns + column % columns) * bands + b];
  const lit = inSpace() ? (foot ? foot.edge * Math.exp(Math.min(0, foot.sun - HEAD.sun_axis[0])) : 0) : 1;
  return HEAD.fields[field].wavelength_nm.map((_, b) => lit * Math.exp(
    (1 - v) * ((1 - w) * at(j, i, b) + w * at(j, i + 1, b)) + v * ((1 - w) * at(j + 1, i, b) + w * at(j + 1, i + 1, b)),
  ));
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
