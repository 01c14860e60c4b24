// The sky of sliders: a worker computes its table anew whenever the air, the observer or the sun is another.
const AMOUNTS = ["aerosol", "stratosphere", "ozone", "albedo"];
const sliders = { worker: null, asked: "", busy: false, error: 0, milliseconds: 0 };

// What the worker is asked for: factors of the amounts that the page was made of.
function questionOf() {
  const { now } = HEAD.air, [aerosol, stratosphere, ozone] = AMOUNTS.map((name) => (now[name] > 0 ? state[name] / now[name] : 1));
  return { aerosol, stratosphere, ozone, albedo: state.albedo, observer: state.altitude - HEAD.altitude_km[0], sun: theSun().shown };
}

// The first sky; then `followSliders` asks for more.
function startAir() {
  const { column, columns, now } = HEAD.air, { log_spectrum: logSpectrum, colour, ozone, model, below, above } = tables;
  sliders.worker = new Worker(URL.createObjectURL(new Blob([HEAD.worker], { type: "text/javascript" })));
  sliders.worker.postMessage({ model, below, above, ozone, colour, logSpectrum, column, columns, rows: HEAD.row_deg, albedo: now.albedo, phaseCount: LINE / 4 });
  return new Promise((resolve, reject) => {
    sliders.worker.onerror = (e) => reject(new Error(e.message));
    sliders.worker.onmessage = ({ data }) => { takeSky(data); resolve(); };
    followSliders();
  });
}

function followSliders() {
  const question = questionOf(), asked = JSON.stringify(question);
  if (sliders.busy || asked === sliders.asked) return;
  Object.assign(sliders, { asked, busy: true });
  sliders.worker.postMessage(question);
}

function takeSky({ smooth, aureole, phase, spectrum, apparent, error, milliseconds }) {
  const rows = HEAD.row_deg.length, columns = HEAD.column_deg.length, shape = (n) => ({ shape: [n, 1, 1, rows, columns] });
  Object.assign(tables, { sky0: smooth, aureole0: aureole, phase0: phase, spectrum0: spectrum });
  Object.assign(HEAD.arrays, { sky0: shape(4), aureole0: shape(4), spectrum0: shape(HEAD.fields[0].wavelength_nm.length) });
  HEAD.fields[0].lift_deg = [[apparent - JSON.parse(sliders.asked).sun]];
  Object.assign(sliders, { busy: false, error, milliseconds });
  sliced = "";
  redraw();
}

// Ranges of the sliders, and those that have nothing to change.
function startSliders() {
  if (HEAD.kind !== "air") return;
  for (const name of AMOUNTS) {
    byId(name).min = 0;
    byId(name).max = positionOf(name, HEAD.air.most[name]);
    byId(name).parentElement.hidden = !(HEAD.air.most[name] > 0);
  }
}
